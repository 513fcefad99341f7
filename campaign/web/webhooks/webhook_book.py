"""Webhooks and what is to be delivered to them, in the server's database: killed at any time, it loses none."""

import json
import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from sqlite3 import Row

from campaign.web.access.database import Database
from campaign.web.access.secret_words import new_secret
from campaign.web.webhooks.campaign_news import CampaignNews

FIRST_PAUSE, LONGEST_PAUSE = 10.0, 3600.0  # s between two attempts, each twice as long as the one before
MOST_ATTEMPTS = 32  # with these pauses they take a day
PAST = "past"  # status of what had happened before there was the webhook


@dataclass(frozen=True)
class Webhook:
    """Where a user wants news sent.

    Attributes
    ----------
    id : int
    user : str
        Whose it is.
    campaign : str or None
        The campaign that it is about; None: all that the user owns or submitted.
    url : str
    secret : str
        With which bodies are signed.
    created : float
        [s since 1970]
    """

    id: int
    user: str
    campaign: str | None
    url: str
    secret: str = field(repr=False)
    created: float

    def wants(self, news: CampaignNews) -> bool:
        """Return whether the webhook gets some news."""
        return self.campaign == news.campaign if self.campaign else self.user in news.people


@dataclass(frozen=True)
class Delivery:
    """News on its way to a webhook.

    Attributes
    ----------
    id, webhook : int
    event : str
        Key of the news.
    body : str
        JSON.
    attempts : int
        How often it was sent.
    next : float or None
        When it is sent next [s since 1970]; None: never.
    status : str
        ``waiting``, ``delivered``, ``given up``, or why the last attempt failed.
    """

    id: int
    webhook: int
    event: str
    body: str
    attempts: int
    next: float | None
    status: str


class WebhookBook:
    """The webhooks of a server.

    Parameters
    ----------
    database : Database
        Where they are kept.
    """

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(self, user: str, campaign: str | None, url: str, past: Iterable[CampaignNews]) -> Webhook:
        """Make a webhook; it gets no news of what happened before."""
        values = (user, campaign, url, new_secret("webhook"), time.time())
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
        """Return the webhooks of a user, or of all users who are not disabled."""
        rows = self._database.rows(
            "SELECT w.* FROM webhooks w JOIN users u ON u.name = w.user"
            " WHERE NOT u.disabled AND (? IS NULL OR w.user = ?) ORDER BY w.id",
            user, user,
        )  # fmt: skip
        return [Webhook(**dict(row)) for row in rows]

    def remove(self, webhook_id: int) -> None:
        """Remove a webhook, with what was to be delivered to it."""
        with self._database.write() as connection:
            connection.execute("DELETE FROM webhooks WHERE id = ?", (webhook_id,))

    def tell(self, news: Iterable[CampaignNews]) -> None:
        """Queue news for the webhooks that want it; what they have got before is left out."""
        webhooks = self.all()
        rows = [
            (webhook.id, each.key, json.dumps({"id": f"{webhook.id} {each.key}", **each.content}), time.time())
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

    def due(self, now: float, count: int) -> list[tuple[Webhook, Delivery]]:
        """Return deliveries whose time has come, the oldest first."""
        webhooks = {webhook.id: webhook for webhook in self.all()}
        rows = self._database.rows("SELECT * FROM deliveries WHERE next <= ? ORDER BY next LIMIT ?", now, 10 * count)
        found = [_delivery(row) for row in rows]
        return [(webhooks[each.webhook], each) for each in found if each.webhook in webhooks][:count]

    def record(self, delivery: Delivery, fault: str | None) -> None:
        """Record an attempt: delivered, or what went wrong; after a day it is given up."""
        attempts = delivery.attempts + 1
        pause = min(FIRST_PAUSE * 2.0 ** min(delivery.attempts, 20), LONGEST_PAUSE)
        is_over = fault is None or attempts >= MOST_ATTEMPTS
        following = None if is_over else time.time() + pause
        status = "delivered" if fault is None else f"given up: {fault}" if is_over else fault
        with self._database.write() as connection:
            connection.execute(
                "UPDATE deliveries SET attempts = ?, next = ?, status = ? WHERE id = ?",
                (attempts, following, status[:200], delivery.id),
            )

    def deliveries(self, webhook_id: int, count: int = 50) -> list[Delivery]:
        """Return the last deliveries of a webhook, newest first."""
        rows = self._database.rows(
            "SELECT * FROM deliveries WHERE webhook = ? AND status != ? ORDER BY id DESC LIMIT ?",
            webhook_id,
            PAST,
            count,
        )
        return [_delivery(row) for row in rows]


def _delivery(row: Row) -> Delivery:
    return Delivery(**dict(row))
