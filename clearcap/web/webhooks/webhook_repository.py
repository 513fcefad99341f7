"""Events of campaigns, and webhooks with their deliveries in the server's database; none is lost if it is killed."""

import json
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from sqlite3 import Row
from typing import Any

from clearcap.web.access.database import Database
from clearcap.web.access.secrets import new_secret
from clearcap.web.watch.entry import CampaignEntry

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
    """Return the news that follows from the state of a campaign; as the state is in the store, no restart loses news.

    `address` is that of the server, for the link; `now` is in seconds since 1970.
    """
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
        with self._database.write() as connection:
            connection.execute("DELETE FROM webhooks WHERE id = ?", (webhook_id,))

    def tell(self, news: Iterable[CampaignEvent]) -> None:
        """Queue news for the webhooks that want it, except news that was queued for them before."""
        webhooks = self.all()
        rows = [
            (webhook.id, each.key, json.dumps({"id": f"{webhook.id} {each.key}", **each.content}), self._clock())
            for each in news
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
        rows = self._database.rows(statement, self._clock(), 10 * count)
        found = [_delivery(row) for row in rows]
        return [(webhooks[each.webhook], each) for each in found if each.webhook in webhooks][:count]

    def record(self, delivery: Delivery, fault: str | None) -> None:
        """Record the success or fault of an attempt; after a day of attempts the delivery is given up."""
        attempts = delivery.attempts + 1
        pause = min(FIRST_PAUSE * 2.0 ** min(delivery.attempts, 20), LONGEST_PAUSE)
        is_over = fault is None or attempts >= MOST_ATTEMPTS
        following = None if is_over else self._clock() + pause
        status = "delivered" if fault is None else f"given up: {fault}" if is_over else fault
        with self._database.write() as connection:
            connection.execute(
                "UPDATE deliveries SET attempts = ?, next = ?, status = ? WHERE id = ?",
                (attempts, following, status[:200], delivery.id),
            )

    def deliveries(self, webhook_id: int, count: int = 50) -> list[Delivery]:
        """Return the last `count` deliveries of a webhook, newest first."""
        rows = self._database.rows(
            "SELECT * FROM deliveries WHERE webhook = ? AND status != ? ORDER BY id DESC LIMIT ?",
            webhook_id,
            PAST,
            count,
        )
        return [_delivery(row) for row in rows]


def _delivery(row: Row) -> Delivery:
    return Delivery(**dict(row))
