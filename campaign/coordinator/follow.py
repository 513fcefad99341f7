"""Follow a campaign from outside, by what its coordinator writes into the store."""

import time
from collections.abc import Iterator
from dataclasses import replace

from campaign.coordinator.heartbeat import Heartbeat
from campaign.coordinator.lease import HEARTBEAT_INTERVAL
from campaign.coordinator.state import state_of
from campaign.store import Store
from campaign.store.layout import HEARTBEAT


def heartbeats(store: Store, campaign_id: str) -> Iterator[Heartbeat]:
    """Yield a campaign's heartbeats as they come, the last with the state in which it ended.

    A campaign that is queued is waited for.
    """
    while True:
        state = state_of(store, campaign_id)
        heartbeat = Heartbeat.from_json(store.read_json(campaign_id, HEARTBEAT) or {}) or _none_yet(store, campaign_id)
        yield replace(heartbeat, state=state["state"], message=state["message"])
        if state["state"] not in ("running", "queued"):
            return
        time.sleep(HEARTBEAT_INTERVAL / 2)


def _none_yet(store: Store, campaign_id: str) -> Heartbeat:
    """Return what is known of a campaign that nobody has driven yet."""
    plan = store.plan(campaign_id)
    survey = store.survey(plan)
    ok = survey.statuses.get("ok", 0)
    samples = store.end(plan)
    counts = (samples, survey.rows, ok, survey.rows - ok, samples - survey.rows)
    return Heartbeat(campaign_id, "planned", *counts, survey.statuses, 0.0, None, 0)
