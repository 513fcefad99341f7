"""Follow a campaign by the heartbeats that its coordinator writes into the store."""

import logging
import time
from collections.abc import Iterator
from dataclasses import replace

from campaign.coordinator.heartbeat import Heartbeat
from campaign.coordinator.lease import HEARTBEAT_INTERVAL
from campaign.coordinator.state import state_of
from campaign.store import Store
from campaign.store.layout import HEARTBEAT

logger = logging.getLogger(__name__)


def heartbeats(store: Store, campaign_id: str) -> Iterator[Heartbeat]:
    """Yield the heartbeats of a campaign as they are written, the last with the state in which the campaign ended.

    A queued campaign is waited for.
    """
    said: set[str] = set()
    while True:
        state = state_of(store, campaign_id)
        document = store.read_json(campaign_id, HEARTBEAT)
        written = Heartbeat.from_json(document or {})
        odd = state["fault"] or (f"{HEARTBEAT} was not written by clearcap" if document and not written else None)
        if odd and odd not in said:
            logger.warning("%s: %s", campaign_id, odd)
            said.add(odd)
        heartbeat = written or _before_first(store, campaign_id)
        yield replace(heartbeat, state=state["state"], message=state["message"])
        if state["state"] not in ("running", "queued"):
            return
        time.sleep(HEARTBEAT_INTERVAL / 2)


def _before_first(store: Store, campaign_id: str) -> Heartbeat:
    """Return a heartbeat for a campaign that no coordinator has written one for."""
    plan = store.plan(campaign_id)
    survey = store.survey(plan)
    ok = survey.statuses.get("ok", 0)
    samples = store.end(plan)
    counts = (samples, survey.rows, ok, survey.rows - ok, samples - survey.rows)
    return Heartbeat(campaign_id, "planned", *counts, survey.statuses, 0.0, None, 0)
