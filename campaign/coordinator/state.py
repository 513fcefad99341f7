"""What a campaign is doing, as whoever did it last said: ``state.json`` in its folder."""

import time
from typing import Any

from campaign.coordinator.lease import is_coordinated, this_process
from campaign.store import Store
from campaign.store.layout import STATE

STATES = ("queued", "running", "completed", "cancelled", "failed", "interrupted")


def write_state(store: Store, campaign_id: str, state: str, message: str = "", *, to_go_on: bool = False) -> None:
    """Write down a new state, and whether a coordinator that serves the store is to go on from it."""
    process = this_process()
    content = {"state": state, "since": time.time(), "message": message, "open": to_go_on}
    content |= {"pid": process["pid"], "on": process["name"]}
    store.write_json(campaign_id, STATE, content)


def close_campaign(store: Store, campaign_id: str, message: str | None = None) -> None:
    """Say that nothing is left to do for a completed campaign, and perhaps why its report is missing."""
    said = store.read_json(campaign_id, STATE) or {}
    added = {} if message is None else {"message": message}
    store.write_json(campaign_id, STATE, {**said, **added, "open": False})


def state_of(store: Store, campaign_id: str) -> dict[str, Any]:
    """Return what a campaign is doing: ``state``, ``message``, ``since``, and whether it is ``open`` for a service.

    One that is said to run and that nobody drives any more is ``interrupted``, and open like one that is queued; one of
    which nothing is said is ``planned``.
    """
    said = store.read_json(campaign_id, STATE) or {}
    state = said.get("state") if said.get("state") in STATES else "planned"
    orphaned = state == "running" and not is_coordinated(store, campaign_id)
    return {
        "state": "interrupted" if orphaned else state,
        "message": str(said.get("message", "")),
        "since": said.get("since"),
        "open": orphaned or state == "queued" or said.get("open") is True,
    }
