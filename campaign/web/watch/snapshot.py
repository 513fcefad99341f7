"""The progress of a campaign as its followers see it."""

import json
from dataclasses import dataclass
from hashlib import sha256
from typing import Any

from campaign.coordinator.heartbeat import Observation
from reporting.capability.intervals import cpk_interval

CONFIDENCE = 0.95
PRELIMINARY = "normal theory for independent samples; the report looks at their shape and may give a wider one"


@dataclass(frozen=True)
class Snapshot:
    """The progress of a campaign at one moment."""

    state: str  # see `Observation`
    is_over: bool  # nothing more happens unless somebody requests it
    data: str  # the whole progress as JSON on one line
    id: str  # digest of the data; a follower that reconnects sends it to say what it has seen

    @property
    def event(self) -> bytes:
        """The snapshot as a server-sent event."""
        return f"id: {self.id}\nevent: progress\ndata: {self.data}\n\n".encode()


def snapshot(seen: Observation, *, is_served: bool) -> Snapshot:
    """Return the snapshot that followers get of an observation; see `progress_of`."""
    progress = progress_of(seen, is_served=is_served)
    data = json.dumps(progress, allow_nan=False, separators=(",", ":"))
    return Snapshot(seen.state, progress["over"], data, sha256(data.encode()).hexdigest()[:16])


def progress_of(seen: Observation, *, is_served: bool) -> dict[str, Any]:
    """Return the progress that an observation shows, as plain data; counts are None before the first heartbeat.

    Each Cpk has an interval by normal theory, which narrows as rows arrive and may differ from that of the report.
    `is_served` says that a coordinator of the store is kept alive, so that interrupted campaigns are continued and
    reports are still written.
    """
    beat = seen.heartbeat
    document: dict[str, Any] = {"campaign": seen.campaign, "state": seen.state, "message": seen.message}
    document |= {"since": seen.since, "over": seen.is_over and not (is_served and seen.is_open), "odd": seen.odd}
    counts = ("samples", "done", "ok", "failed", "left", "statuses", "rate", "eta_s", "workers", "repeats", "repeated")
    document |= {name: None if beat is None else getattr(beat, name) for name in counts}
    responses = {} if beat is None else beat.responses
    document["responses"] = {
        name: response | {"cpk_interval": _interval(response)} for name, response in responses.items()
    }
    return document | {"interval": PRELIMINARY}


def _interval(response: dict[str, float | None]) -> tuple[float, float] | None:
    """Return the interval of a Cpk; None if there is no Cpk or there are fewer than three values."""
    cpk, n = response["cpk"], response["n"]
    return None if cpk is None or not n or n < 3 else cpk_interval(cpk, int(n), CONFIDENCE)
