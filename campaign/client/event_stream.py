"""The events of a campaign, as a server sends them; a lost connection continues after the last one seen."""

import json
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from campaign.client.server_connection import ServerConnection
from campaign.errors import StoreError, UnreachableError

SILENCE = 60.0  # s without a word, after which the connection counts as lost; a server speaks every 15 s
PATIENCE = 600.0  # s for which a server may be away


@dataclass
class SentEvent:
    """A server-sent event.

    Attributes
    ----------
    kind : str
        Its name.
    data : str
        What it says.
    id : str
        By which a follower that comes back says what it has seen; empty if it has none.
    """

    kind: str = "message"
    data: str = ""
    id: str = ""


def events_in(lines: Iterable[str]) -> Iterator[SentEvent]:
    """Yield the events in the lines of a stream; one that is not complete is left out.

    Parameters
    ----------
    lines : iterable of str
        Without their ends.
    """
    event, data = SentEvent(), list[str]()
    for line in lines:
        if not line:
            if data:
                event.data = "\n".join(data)
                yield event
            event, data = SentEvent(), []
            continue
        field, _, value = line.partition(":")
        value = value.removeprefix(" ")
        if field == "event":
            event.kind = value
        elif field == "data":
            data.append(value)
        elif field == "id":
            event.id = value


def progress_events(connection: ServerConnection, campaign_id: str) -> Iterator[dict[str, Any]]:
    """Yield how far a campaign is whenever that changes, until nothing more happens to it.

    Parameters
    ----------
    connection : ServerConnection
    campaign_id : str
        Its whole id.

    Raises
    ------
    UnreachableError
        If the server cannot be reached for ten minutes.
    CampaignError
        If it refuses.
    """
    last, tried, heard = "", 0, time.monotonic()
    while True:
        headers = {"Accept": "text/event-stream"} | ({"Last-Event-ID": last} if last else {})
        try:
            with connection.stream(f"/campaigns/{campaign_id}/events", headers=headers, timeout=SILENCE) as response:
                for event in events_in(response.iter_lines()):
                    tried, heard = 0, time.monotonic()
                    if event.kind == "end":
                        return
                    if event.kind == "progress":
                        last = event.id or last
                        yield json.loads(event.data)
        except (UnreachableError, StoreError):  # also that of a proxy whose server starts again
            if time.monotonic() - heard > PATIENCE:
                raise
        tried += 1
        connection.wait(tried)
