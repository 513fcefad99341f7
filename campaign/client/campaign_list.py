"""The list of a server's campaigns, requested page by page."""

import math
import time
from collections.abc import Iterator, Mapping
from typing import Any

from campaign.client.server_connection import ServerConnection
from campaign.errors import UnreachableError

ON_A_PAGE = 500  # campaigns
ASK_AGAIN = 0.5  # s between requests while the server still reads its store for the first time
GIVE_UP_AFTER = 60.0  # s without progress in that reading


def listed_campaigns(connection: ServerConnection, question: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the list entry of each campaign, once the server has read all of its store.

    `question` has ``search``, ``owner``, ``tag`` (a list), ``state``, ``archived`` and ``sort``, as in the API. Raises
    UnreachableError if the server makes no progress in reading its store for a minute.
    """
    cursor: str | None = ""
    while cursor is not None:
        listing = _whole(connection, {**question, "cursor": cursor, "limit": ON_A_PAGE})
        yield from listing["campaigns"]
        cursor = listing["next"]


def _whole(connection: ServerConnection, params: Mapping[str, Any]) -> dict[str, Any]:
    """Return a page of the list, once the server has read all campaigns."""
    least, since = math.inf, time.monotonic()
    while True:
        listing: dict[str, Any] = connection.get("/campaigns", params=params).json()
        unread, now = listing.get("unread", 0), time.monotonic()  # older servers read all campaigns before they answer
        if not unread:
            return listing
        if unread < least:
            least, since = unread, now
        elif now - since > GIVE_UP_AFTER:
            raise UnreachableError(
                f"server {connection.address}: {unread} campaigns of its store are still to be read, and none was read"
                f" in {GIVE_UP_AFTER:.0f} s; its log says why; the same command works later"
            )
        time.sleep(ASK_AGAIN)
