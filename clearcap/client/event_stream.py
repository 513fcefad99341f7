"""The event stream of a campaign; after a lost connection it continues after the last event seen."""

import json
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from campaign.errors import StoreError, UnreachableError
from clearcap.client.server_connection import ServerConnection

SILENCE = 60.0  # s without data after which the connection counts as lost; a server sends something every 15 s
PATIENCE = 600.0  # s that a server may be unreachable


@dataclass
class SentEvent:
    """A server-sent event."""

    kind: str = "message"  # name of the event
    data: str = ""
    id: str = ""  # a reconnecting client sends it to say what it has seen; empty if the event has none


def events_in(lines: Iterable[str]) -> Iterator[SentEvent]:
    """Yield the events in the lines, without line ends, of a stream; an incomplete last event is left out."""
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
    """Yield the progress of a campaign whenever it changes, until nothing more happens to the campaign.

    Raises UnreachableError if the server cannot be reached for ten minutes, CampaignError if it refuses the request.
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
                        last = event.id or last  # an event without an id does not change what to continue after
                        yield json.loads(event.data)
        except (UnreachableError, StoreError):  # also from a proxy whose server restarts
            if time.monotonic() - heard > PATIENCE:
                raise
        # also after a stream that ended without the event "end": a server that shuts down ends its streams so
        tried += 1
        connection.wait(tried)
