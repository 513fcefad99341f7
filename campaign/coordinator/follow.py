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
    """What one look at a campaign shows; two are equal if a follower of the first has nothing to learn from the second.

    Attributes
    ----------
    campaign : str
        Id of the campaign.
    state, message : str
        As `state_of` gives them; the state is ``gone`` where there is no plan, state or heartbeat.
    since : float or None
        When the state began [s since 1970].
    is_open : bool
        Whether a coordinator that serves the store would continue the campaign.
    heartbeat : Heartbeat or None
        The last one, with the state and the message above; None if there is none that clearcap wrote.
    odd : str or None
        What the files say that clearcap never writes.
    sign : SignOfLife or None
        Of the coordinator, while the state is ``running``.
    """

    campaign: str
    state: str
    message: str
    since: float | None
    is_open: bool
    heartbeat: Heartbeat | None
    odd: str | None
    sign: SignOfLife | None = field(compare=False)

    @property
    def is_over(self) -> bool:
        """Whether nothing more happens unless somebody asks for it."""
        return self.state not in ("running", "queued")


def observe(
    store: Store, campaign_id: str, earlier: Observation | None = None, now: float | None = None
) -> Observation:
    """Look at a campaign once: four small files at most, and nothing waits, so one poller can look at many campaigns.

    Parameters
    ----------
    store : Store
        Where the campaign is; use `Store.hasty` where nothing may wait for a store that cannot be reached.
    campaign_id : str
        Its whole id.
    earlier : Observation, optional
        What the look before returned: a coordinator on another machine is judged by two looks.
    now : float, optional
        By default the monotonic clock of this process [s].

    Raises
    ------
    StoreError
        If a file cannot be read.
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
    """Yield the heartbeats of a campaign as they are written, the last with the state in which the campaign ended.

    A queued campaign is waited for. It sleeps between two looks: for one follower, and not for a server.
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
        time.sleep(HEARTBEAT_INTERVAL / 2)


def _before_first(store: Store, campaign_id: str) -> Heartbeat:
    """Return a heartbeat for a campaign that no coordinator has written one for."""
    plan = store.plan(campaign_id)
    survey = store.survey(plan)
    ok = survey.statuses.get("ok", 0)
    samples = store.end(plan)
    counts = (samples, survey.rows, ok, survey.rows - ok, samples - survey.rows)
    return Heartbeat(campaign_id, "planned", *counts, survey.statuses, 0.0, None, 0)
