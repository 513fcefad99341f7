"""The state of a campaign: ``state.json`` in its folder, replaced whenever the state changes."""

import time
from collections.abc import Sequence
from typing import Any

from campaign.coordinator.lease import is_coordinated, this_process
from campaign.store import Store
from campaign.store.layout import CANCEL, HEARTBEAT, STATE

BEING_CANCELLED = "cancelled; it stops within seconds"
LATEST = 32_503_680_000.0  # s since 1970: the year 3000
STATES = ("queued", "running", "completed", "cancelled", "failed", "interrupted")


def write_state(
    store: Store, campaign_id: str, state: str, message: str = "", *, is_open: bool = False, options: Sequence[str] = ()
) -> None:
    """Write a new state, the options of its command, and whether a service shall continue the campaign."""
    process = this_process()
    content = {"state": state, "since": time.time(), "message": message, "open": is_open, "options": [*options]}
    content |= {"pid": process["pid"], "on": process["name"]}
    store.write_json(campaign_id, STATE, content)


def resume_command(store: Store, campaign_id: str) -> str:
    """Return the command that continues a campaign where it was computed last."""
    return store.command("resume", campaign_id, *state_of(store, campaign_id)["options"])


def close_campaign(store: Store, campaign_id: str, message: str | None = None) -> None:
    """Mark a completed campaign as done; ``message`` says why its report is missing, if it is."""
    state = store.read_json(campaign_id, STATE) or {}
    added = {} if message is None else {"message": message}
    store.write_json(campaign_id, STATE, {**state, **added, "open": False})


def state_of(store: Store, campaign_id: str) -> dict[str, Any]:
    """Return ``state``, ``message``, ``since``, ``options`` of a campaign, and whether it is ``open`` for a service."""
    # A campaign that is running according to its file but has no living coordinator is ``interrupted``, and open like a
    # queued one. Without a state in the file, it follows from the heartbeat; if that says ``completed``, the campaign
    # is open, because its report may be missing. Values that clearcap never writes are ignored, and ``fault`` names
    # them.
    content = store.read_json(campaign_id, STATE) or {}
    is_written = content.get("state") in STATES
    said = content if is_written else store.read_json(campaign_id, HEARTBEAT) or {}
    state = said["state"] if is_written or said.get("state") in ("running", "completed") else "planned"
    orphaned = state == "running" and not is_coordinated(store, campaign_id)
    if orphaned and is_written and store.read_json(campaign_id, STATE) != content:
        return state_of(store, campaign_id)  # its coordinator wrote the last state, and gave the lease back, meanwhile
    is_lost = not is_written and state == "completed"
    is_ending = state == "running" and not orphaned and store.files.exists(f"{campaign_id}/{CANCEL}")
    return {
        "state": "interrupted" if orphaned else state,
        "message": BEING_CANCELLED if is_ending else str(content.get("message", "")),
        "since": _date(content.get("since")),
        "open": orphaned or is_lost or state == "queued" or content.get("open") is True,
        "fault": _fault(content),
        "options": _options(content.get("options")),
    }


def _fault(content: dict[str, Any]) -> str | None:
    """Return the message about values in a state file that clearcap never writes; None if there are none."""
    sound = {
        "state": content.get("state") in (None, *STATES),
        "since": content.get("since") is None or _date(content["since"]) is not None,
        "message": isinstance(content.get("message", ""), str),
    }
    odd = [f"{name} = {content[name]!r:.60}" for name, is_sound in sound.items() if not is_sound]
    return f"{STATE} says {', '.join(odd)}, which clearcap never writes; restore or remove it" if odd else None


def _options(given: Any) -> list[str]:
    """Return the options in a state file; none if it has anything else there, as before they were kept."""
    return given if isinstance(given, list) and all(isinstance(word, str) for word in given) else []


def _date(since: Any) -> float | None:
    """Return when a state began [s since 1970]; None if the file has no number from 1970 to the year 3000."""
    is_number = isinstance(since, int | float) and not isinstance(since, bool)
    return float(since) if is_number and 0.0 <= since < LATEST else None
