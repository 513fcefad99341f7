"""Follow campaigns by the heartbeats that their coordinators write into the store."""

import logging
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

from campaign.coordinator.heartbeat import Heartbeat
from campaign.coordinator.lease import HEARTBEAT_INTERVAL, SignOfLife, judge_life
from campaign.coordinator.state import state_of
from campaign.store import Store
from campaign.store.layout import HEARTBEAT, LEASE, PLAN

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Observation:
    """One observation of a campaign; equal to an earlier one if it shows a follower nothing new."""

    campaign: str  # its id
    state: str  # as in `state_of`; ``gone`` if there is no plan, state or heartbeat
    message: str
    since: float | None  # when the state began [s since 1970]
    is_open: bool  # whether a coordinator that serves the store would continue the campaign
    heartbeat: Heartbeat | None  # the last one, with the state and the message above; None if clearcap wrote none
    odd: str | None  # content of the files that clearcap never writes
    sign: SignOfLife | None = field(compare=False)  # of the coordinator, while the state is ``running``

    @property
    def is_over(self) -> bool:
        """Whether nothing more happens without a new request."""
        return self.state not in ("running", "queued")


def observe(
    store: Store, campaign_id: str, earlier: Observation | None = None, now: float | None = None
) -> Observation:
    """Observe a campaign once, from at most four small files and without waiting, so that one poller can observe many.

    Use `Store.hasty` to avoid waiting for an unreachable store. Judging a coordinator on another machine takes the
    ``earlier`` observation too. ``now`` is the time of a monotonic clock [s], None for that of this process. Raises
    StoreError if a file cannot be read.
    """
    state, document = state_of(store, campaign_id), store.read_json(campaign_id, HEARTBEAT)
    written, sign = Heartbeat.from_json(document or {}), None
    if state["state"] == "running":
        at = time.monotonic() if now is None else now
        before = None if earlier is None else earlier.sign
        sign = judge_life(store.read_json(campaign_id, LEASE), document, before, at)
    is_gone = state["state"] == "planned" and not store.files.exists(f"{campaign_id}/{PLAN}")
    name, message = "gone" if is_gone else state["state"], state["message"]
    return Observation(
        campaign_id,
        name,
        message,
        state["since"],
        state["open"],
        written and replace(written, state=name, message=message),
        state["fault"] or (f"{HEARTBEAT} was not written by clearcap" if document and not written else None),
        sign,
    )


def heartbeats(store: Store, campaign_id: str) -> Iterator[Heartbeat]:
    """Yield the heartbeats of a campaign as they are written, the last one with the state in which it ended.

    This waits for a queued campaign. It sleeps between two observations, so it suits one follower but not a server.
    """
    said: set[str] = set()
    seen: Observation | None = None
    while True:
        seen = observe(store, campaign_id, seen)
        if seen.odd and seen.odd not in said:
            logger.warning("%s: %s", campaign_id, seen.odd)
            said.add(seen.odd)
        yield seen.heartbeat or replace(_before_first(store, campaign_id), state=seen.state, message=seen.message)
        if seen.is_over:
            return
        # twice as often as heartbeats are written, so that none is missed
        time.sleep(HEARTBEAT_INTERVAL / 2)


def _before_first(store: Store, campaign_id: str) -> Heartbeat:
    """Return a heartbeat for a campaign without one from a coordinator."""
    plan = store.plan(campaign_id)
    survey = store.survey(plan)
    ok = survey.statuses.get("ok", 0)
    samples = store.end(plan)
    counts = (samples, survey.rows, ok, survey.rows - ok, samples - survey.rows)
    return Heartbeat(campaign_id, "planned", *counts, survey.statuses, 0.0, None, 0)
