"""Webhooks: events of campaigns, their deliveries in the server database, and the sender.

None is lost if the server is killed. They are sent by TLS until the receiver accepts them, and into the own network of
the server only to hosts that an admin allows.
"""

import asyncio
import hashlib
import hmac
import ipaddress
import json
import logging
import socket
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import urlsplit

import httpx

from campaign.errors import SpecError
from campaign.processes import is_loopback
from clearcap.web.access.database import Database
from clearcap.web.access.users import new_secret
from clearcap.web.index import CampaignEntry

ENDED = ("completed", "failed", "cancelled", "interrupted")
REPORT_WITHIN = 600.0  # s after the end of a completed campaign that its news waits for the report
FIRST_PAUSE, LONGEST_PAUSE = 10.0, 3600.0  # s between two attempts; each pause is twice as long as the previous one
MOST_ATTEMPTS = 32  # with these pauses they take a day
PAST = "past"  # status of news from before the webhook was created


@dataclass(frozen=True)
class CampaignEvent:
    """Something that happened to a campaign."""

    key: str  # identifies event, time and campaign; news with the same key is sent only once
    campaign: str
    people: frozenset[str]  # users who own or submitted the campaign
    content: dict[str, Any]  # plain data


def campaign_events(entry: CampaignEntry, address: str, now: float | None = None) -> list[CampaignEvent]:
    """Return the news that follows from the state of a campaign, which is in the store: no restart loses news."""
    if entry.state not in ENDED:
        return []
    since = 0.0 if entry.since is None else entry.since.timestamp()
    lacks_report = entry.state == "completed" and not entry.has_report and not entry.message
    if lacks_report and (time.time() if now is None else now) - since < REPORT_WITHIN:
        return []
    about = {"campaign": entry.campaign, "title": entry.title, "owner": entry.owner, "tags": entry.tags}
    about |= {"link": f"{address}/campaigns/{entry.campaign}"}
    ended = {"event": "campaign.ended", **about, "state": entry.state, "message": entry.message}
    ended |= entry.model_dump(
        mode="json", include={"since", "samples", "done", "failed", "share_ok", "weakest", "headline"}
    )
    people = frozenset({entry.owner, entry.submitted_by} - {""})
    # with the time, so that a campaign that is resumed and ends again is news again; a low Cpk is news only once
    news = [CampaignEvent(f"ended {entry.campaign} {entry.state} {since:.3f}", entry.campaign, people, ended)]
    for fall in entry.falls:  # with the number, so that an index that rose and falls again is news again
        content = {"event": "index.below", **about, **fall.model_dump(mode="json")}
        key = f"fall {entry.campaign} {fall.number} {fall.response}"
        news.append(CampaignEvent(key, entry.campaign, people, content))
    for below in entry.below_target:
        content = {"event": "cpk.below", **about, **below.model_dump(mode="json")}
        news.append(CampaignEvent(f"below {entry.campaign} {below.response}", entry.campaign, people, content))
    return news


@dataclass(frozen=True)
class Webhook:
    """An address that a user wants news sent to."""

    id: int
    user: str
    campaign: str | None  # None for all that the user owns or submitted
    url: str
    secret: str = field(repr=False)  # key that the bodies are signed with
    created: float  # [s since 1970]

    def wants(self, news: CampaignEvent) -> bool:
        """Return whether the webhook is to get a piece of news."""
        return self.campaign == news.campaign if self.campaign else self.user in news.people


@dataclass(frozen=True)
class Delivery:
    """The delivery of news to a webhook."""

    id: int
    webhook: int  # id
    event: str  # key of the news
    body: str  # JSON
    attempts: int  # so far
    next: float | None  # time of the next attempt [s since 1970]; None if there is none
    status: str  # ``waiting``, ``delivered``, ``given up`` with the reason, or why the last attempt failed


class WebhookRepository:
    """The webhooks of a server; `clock` returns the time in seconds since 1970."""

    def __init__(self, database: Database, clock: Callable[[], float] = time.time) -> None:
        self._database, self._clock = database, clock

    def add(self, user: str, campaign: str | None, url: str, past: Iterable[CampaignEvent]) -> Webhook:
        """Create a webhook, which gets none of the `past` news."""
        values = (user, campaign, url, new_secret("webhook"), self._clock())
        with self._database.write() as connection:
            made = connection.execute(
                "INSERT INTO webhooks (user, campaign, url, secret, created) VALUES (?, ?, ?, ?, ?)", values
            )
            assert made.lastrowid is not None
            webhook = Webhook(made.lastrowid, *values)
            connection.executemany(
                "INSERT INTO deliveries (webhook, event, body, attempts, status) VALUES (?, ?, '', 0, ?)",
                [(webhook.id, news.key, PAST) for news in past if webhook.wants(news)],
            )
        return webhook

    def all(self, user: str | None = None) -> list[Webhook]:
        """Return the webhooks of a user, or of all users, except disabled ones."""
        rows = self._database.rows(
            "SELECT w.* FROM webhooks w JOIN users u ON u.name = w.user"
            " WHERE NOT u.disabled AND (? IS NULL OR w.user = ?) ORDER BY w.id",
            user, user,
        )  # fmt: skip
        return [Webhook(**dict(row)) for row in rows]

    def remove(self, webhook_id: int) -> None:
        """Remove a webhook and its deliveries."""
        self._database.change("DELETE FROM webhooks WHERE id = ?", webhook_id)

    def enqueue(self, events: Iterable[CampaignEvent]) -> None:
        """Queue events for the webhooks that want them, except those that were queued for them before."""
        webhooks = self.all()
        rows = [
            (webhook.id, each.key, json.dumps({"id": f"{webhook.id} {each.key}", **each.content}), self._clock())
            for each in events
            for webhook in webhooks
            if webhook.wants(each)
        ]
        if rows:
            with self._database.write() as connection:
                connection.executemany(
                    "INSERT OR IGNORE INTO deliveries (webhook, event, body, attempts, next, status)"
                    " VALUES (?, ?, ?, 0, ?, 'waiting')",
                    rows,
                )

    def due(self, count: int) -> list[tuple[Webhook, Delivery]]:
        """Return at most `count` deliveries that are due now, oldest first."""
        webhooks = {webhook.id: webhook for webhook in self.all()}
        statement = "SELECT * FROM deliveries WHERE next <= ? ORDER BY next LIMIT ?"
        # more than `count`, because those of disabled users are left out below and must not block the others
        found = [Delivery(**dict(row)) for row in self._database.rows(statement, self._clock(), 10 * count)]
        return [(webhooks[each.webhook], each) for each in found if each.webhook in webhooks][:count]

    def record(self, delivery: Delivery, fault: str | None) -> None:
        """Record the success or fault of an attempt; after a day of attempts the delivery is given up."""
        attempts = delivery.attempts + 1
        pause = min(FIRST_PAUSE * 2.0 ** min(delivery.attempts, 20), LONGEST_PAUSE)
        is_over = fault is None or attempts >= MOST_ATTEMPTS
        following = None if is_over else self._clock() + pause
        status = "delivered" if fault is None else f"given up: {fault}" if is_over else fault
        statement = "UPDATE deliveries SET attempts = ?, next = ?, status = ? WHERE id = ?"
        self._database.change(statement, attempts, following, status[:200], delivery.id)

    def deliveries(self, webhook_id: int, count: int = 50) -> list[Delivery]:
        """Return the last `count` deliveries of a webhook, newest first."""
        statement = "SELECT * FROM deliveries WHERE webhook = ? AND status != ? ORDER BY id DESC LIMIT ?"
        return [Delivery(**dict(row)) for row in self._database.rows(statement, webhook_id, PAST, count)]


LONGEST_URL = 2000  # characters
# networks whose addresses embed IPv4 addresses, which may be private, or that only documents use
_SPECIAL = "64:ff9b::/96", "64:ff9b:1::/48", "2002::/16", "2001::/32", "192.88.99.0/24", "3fff::/20"
_SPECIAL_NETWORKS = [ipaddress.ip_network(each) for each in _SPECIAL]
LOOK_EVERY = 2.0  # s
AT_ONCE = 8  # deliveries
ANSWER_WITHIN = 10.0  # s
logger = logging.getLogger(__name__)
# httpx logs each URL at the level INFO, and that of a webhook may hold a secret
logging.getLogger("httpx").setLevel(logging.WARNING)


class WebhookSender:
    """Send the `events` of campaigns to webhooks, in the server's own network only to the hosts `allowed`."""

    def __init__(
        self,
        repository: WebhookRepository,
        events: Callable[[], Iterable[CampaignEvent]],
        allowed: Iterable[str],
        clock: Callable[[], float] = time.time,
    ) -> None:
        self._repository, self._events, self._clock = repository, events, clock
        self._allowed = tuple(allowed)
        self._webhooks, self._queued = set[int](), set[str]()  # webhooks, and keys of the events, that are known

    async def run(self) -> None:
        """Send news as it comes, until cancelled."""
        while True:
            try:
                await asyncio.to_thread(self.enqueue)
                due = await asyncio.to_thread(self._repository.due, AT_ONCE)
                await asyncio.gather(*(self._attempt(*each) for each in due))
            except Exception:
                logger.exception("news could not be sent to webhooks")
                due = []
            if len(due) < AT_ONCE:
                await asyncio.sleep(LOOK_EVERY)

    def enqueue(self) -> None:
        """Queue the events since the last call."""
        webhooks = {webhook.id for webhook in self._repository.all()}
        if webhooks != self._webhooks:
            self._webhooks, self._queued = webhooks, set()  # a new webhook may lack some
        if not webhooks:
            return
        events = list(self._events())
        self._repository.enqueue(each for each in events if each.key not in self._queued)
        self._queued = {each.key for each in events}

    async def _attempt(self, webhook: Webhook, delivery: Delivery) -> None:
        """Send news once, and record whether it was accepted."""
        fault = await self.send(webhook, delivery)
        await asyncio.to_thread(self._repository.record, delivery, fault)

    async def send(self, webhook: Webhook, delivery: Delivery) -> str | None:
        """Send news once, to the checked address whatever its name means by then; return why it was not accepted."""
        try:
            target = webhook_target(webhook.url, self._allowed)
            address = (await asyncio.to_thread(target_addresses, target))[0]
            shown = f"[{address}]" if ":" in address else address
            body = delivery.body.encode()
            headers = {
                "Host": target.authority,
                "Content-Type": "application/json",
                "User-Agent": "clearcap",
                "X-Clearcap-Signature": signature(webhook.secret, body, int(self._clock())),
            }
            async with (
                asyncio.timeout(ANSWER_WITHIN),
                # neither a proxy nor a redirect leads to an address that was not checked
                httpx.AsyncClient(trust_env=False, follow_redirects=False, timeout=ANSWER_WITHIN) as client,
                client.stream(
                    "POST",
                    f"{target.scheme}://{shown}:{target.port}{target.rest}",
                    content=body,
                    headers=headers,
                    extensions={"sni_hostname": target.host},  # the URL has the address; the certificate, the name
                ) as response,
            ):
                return None if response.is_success else f"answered with status {response.status_code}"
        except SpecError as error:
            return str(error)
        except TimeoutError:
            return f"no answer within {ANSWER_WITHIN:g} s"
        except (httpx.HTTPError, OSError, ValueError) as error:
            return f"cannot be reached ({type(error).__name__})"


def signature(secret: str, body: bytes, at: int) -> str:
    """Return ``t=SECONDS,v1=HEX``: HMAC-SHA256 of ``SECONDS.BODY``; old ones are refused, so none can be replayed."""
    digest = hmac.new(secret.encode(), f"{at}.".encode() + body, hashlib.sha256).hexdigest()
    return f"t={at},v1={digest}"


@dataclass(frozen=True)
class WebhookTarget:
    """The parts of a webhook's address."""

    scheme: str
    host: str
    port: int
    rest: str  # path and query
    is_allowed: bool  # the configuration names the host, so that it may be in the server's own network

    @property
    def authority(self) -> str:
        """Host and port as in the header ``Host``."""
        shown = f"[{self.host}]" if ":" in self.host else self.host
        return shown if self.port == (443 if self.scheme == "https" else 80) else f"{shown}:{self.port}"


def webhook_target(url: str, allowed: Iterable[str]) -> WebhookTarget:
    """Check the address of a webhook, without looking up its host; the configuration names the hosts `allowed`."""
    try:
        parts = urlsplit(url)
        host, port = (parts.hostname or "").rstrip("."), parts.port
    except ValueError as error:
        raise SpecError(f"url = {url!r:.200}: not an address ({error})") from error
    is_allowed = host in {each.lower() for each in allowed}
    if len(url) > LONGEST_URL or not (url.isascii() and url.isprintable() and " " not in url) or not host:
        raise SpecError(f"url = {url!r:.200}: not an address; write https://HOST/PATH")
    if parts.username is not None or parts.password is not None or parts.fragment:
        raise SpecError("url: holds a user, a password or a fragment; news is signed instead: check the signature")
    if parts.scheme != "https" and not (parts.scheme == "http" and is_allowed and is_loopback(host)):
        raise SpecError(f"url = {url!r:.200}: news is sent by https only")
    if port is not None and (port == 0 or (port != 443 and not is_allowed)):
        raise SpecError(
            f"url = {url!r:.200}: port {port}: news is sent to port 443; for another an admin names the host in the"
            ' configuration: [webhooks] allow = ["HOST"]'
        )
    rest = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
    return WebhookTarget(parts.scheme, host, port or (443 if parts.scheme == "https" else 80), rest, is_allowed)


def target_addresses(target: WebhookTarget) -> list[str]:
    """Look up the addresses of a target and check that news may be sent to each."""
    try:
        found = socket.getaddrinfo(target.host, target.port, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as error:
        raise SpecError(f"url: the host {target.host:.200} has no address ({error})") from error
    addresses = list(dict.fromkeys(str(each[4][0]) for each in found))
    if not target.is_allowed:
        for address in addresses:
            if not is_public(address):
                raise SpecError(
                    f"url: the host {target.host:.200} is in the server's own network; an admin may allow it in the"
                    ' configuration: [webhooks] allow = ["HOST"]'
                )
    return addresses


def is_public(address: str) -> bool:
    """Return whether an address is on the public internet, not in a private, local or translated network."""
    try:
        parsed = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return False
    mapped = getattr(parsed, "ipv4_mapped", None)
    if mapped is not None:
        return is_public(str(mapped))
    is_special = any(parsed in network for network in _SPECIAL_NETWORKS if network.version == parsed.version)
    return parsed.is_global and not (parsed.is_multicast or parsed.is_reserved or is_special)
