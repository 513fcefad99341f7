"""Sending of news to webhooks, which is repeated until the receiver accepts it, and where it may be sent.

It is sent by TLS, and into the server's own network only to hosts that an admin allows.
"""

import asyncio
import hashlib
import hmac
import ipaddress
import logging
import socket
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from urllib.parse import urlsplit

import httpx

from campaign.errors import SpecError
from clearcap.web.webhooks.webhook_repository import CampaignEvent, Delivery, Webhook, WebhookRepository

LONGEST_URL = 2000  # characters
# networks whose addresses embed IPv4 addresses, which may be private
_TRANSLATED = [ipaddress.ip_network(each) for each in ("64:ff9b::/96", "64:ff9b:1::/48", "2002::/16", "2001::/32")]


LOOK_EVERY = 2.0  # s
AT_ONCE = 8  # deliveries
ANSWER_WITHIN = 10.0  # s

logger = logging.getLogger(__name__)


# httpx logs each URL at the level INFO, and that of a webhook may hold a secret
logging.getLogger("httpx").setLevel(logging.WARNING)


class WebhookSender:
    """Send news about campaigns to webhooks, in the server's own network only to the hosts `allowed`.

    `news` returns what follows from the states of all campaigns, `clock` the time in seconds since 1970.
    """

    def __init__(
        self,
        book: WebhookRepository,
        news: Callable[[], Iterable[CampaignEvent]],
        allowed: Iterable[str],
        clock: Callable[[], float] = time.time,
    ) -> None:
        self._book, self._news, self._clock = book, news, clock
        self._allowed = tuple(allowed)
        self._webhooks, self._told = set[int](), set[str]()  # webhooks, and keys of the news, that the book has

    async def run(self) -> None:
        """Send news as it comes, until cancelled."""
        while True:
            try:
                await asyncio.to_thread(self.tell)
                due = await asyncio.to_thread(self._book.due, AT_ONCE)
                await asyncio.gather(*(self._attempt(*each) for each in due))
            except Exception:
                logger.exception("news could not be sent to webhooks")
                due = []
            if len(due) < AT_ONCE:
                await asyncio.sleep(LOOK_EVERY)

    def tell(self) -> None:
        """Enter the news since the last call into the book."""
        webhooks = {webhook.id for webhook in self._book.all()}
        if webhooks != self._webhooks:
            self._webhooks, self._told = webhooks, set()  # a new webhook may not have been told yet
        if not webhooks:
            return
        news = list(self._news())
        self._book.tell(each for each in news if each.key not in self._told)
        self._told = {each.key for each in news}

    async def _attempt(self, webhook: Webhook, delivery: Delivery) -> None:
        """Send news once, and record whether it was accepted."""
        fault = await self.send(webhook, delivery)
        await asyncio.to_thread(self._book.record, delivery, fault)

    async def send(self, webhook: Webhook, delivery: Delivery) -> str | None:
        """Send news once; return why it was not accepted, or None if it was.

        The connection goes to the checked address, even if the host name resolves to another one meanwhile. Redirects
        are not followed, and no proxy is used.
        """
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
    """Return the signature of a body: ``t=SECONDS,v1=HEX``.

    SECONDS is `at`; HEX is the HMAC-SHA256 of ``SECONDS.BODY`` with the secret as key. Receivers refuse old signatures,
    so that nobody can replay a body.
    """
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
    """Check the address of a webhook, without looking up its host; the configuration names the hosts `allowed`.

    Raises SpecError if the URL is invalid, or if news may not be sent there.
    """
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
    if parts.scheme != "https" and not (parts.scheme == "http" and is_allowed and _is_loopback(host)):
        raise SpecError(f"url = {url!r:.200}: news is sent by https only")
    rest = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
    return WebhookTarget(parts.scheme, host, port or (443 if parts.scheme == "https" else 80), rest, is_allowed)


def target_addresses(target: WebhookTarget) -> list[str]:
    """Look up the addresses of a target and check that news may be sent to each.

    Raises SpecError if the host has no address, or one in the server's own network that the configuration does not
    allow.
    """
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
    is_translated = any(parsed in network for network in _TRANSLATED if network.version == parsed.version)
    return parsed.is_global and not (parsed.is_multicast or parsed.is_reserved or is_translated)


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
