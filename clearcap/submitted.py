"""A campaign that goes on in the background: submit it, await it without blocking the loop, or wait for it."""

import asyncio
import os
import time
import warnings
from collections.abc import Generator
from contextlib import suppress
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from campaign.coordinator.failed_runs import lack_of_ok
from campaign.coordinator.heartbeat import Observation, observe
from campaign.coordinator.lease import HEARTBEAT_INTERVAL, SignOfLife, is_coordinated, judge_life
from campaign.coordinator.requests import cancel_campaign
from campaign.coordinator.submit import Assignment, assign_coordinator
from campaign.errors import CampaignError
from campaign.processes import started
from campaign.store.files.retry_policy import PATIENT
from campaign.store.layout import HEARTBEAT, LEASE, SERVICE
from clearcap.results import Results, planned
from clearcap.running import Follower, Progress, Rows

if TYPE_CHECKING:
    from distributed import Client

    from campaign.cluster.cluster import Cluster
    from campaign.coordinator.heartbeat import Heartbeat
    from campaign.spec.load import Campaign, Source

_PAUSE = HEARTBEAT_INTERVAL / 2  # s
_SILENCE = PATIENT.seconds  # s; a coordinator on another machine goes on through as long an outage of its store


class RunningCampaign:
    """A campaign that another process computes: ``await`` it, or `wait` for it; both return its `Results`.

    Awaiting does not block the loop. Whoever waits may be interrupted: the campaign goes on.

    Parameters
    ----------
    results : Results
        What `open_campaign` returned. If it is queued, it is waited for until somebody computes it.
    progress : callable, optional
        Called with each new `Heartbeat`, where the campaign is awaited. What it raises ends the waiting.
    rows : callable, optional
        Called there with tables of finished rows, as in `Results.rows`, each row once, however often it is awaited;
        with a stopping rule also rows after the end, computed ahead.

    Raises
    ------
    CampaignError
        From ``await`` and `wait`: if the campaign is cancelled or interrupted, or fails, or the coordinator that it was
        handed to has ended, or one on another machine has written nothing for minutes.
    """

    def __init__(self, results: Results, progress: Progress = False, rows: Rows | None = None) -> None:
        self._of = results
        self._follower = Follower(results.store, results.plan, progress, rows)
        self._assignment = Assignment("none")
        self._service: SignOfLife | None = None

    @property
    def id(self) -> str:
        """The campaign's id."""
        return self._of.id

    @property
    def heartbeat(self) -> "Heartbeat | None":
        """How far the campaign is now; None before its coordinator has begun."""
        return observe(self._of.store, self.id).heartbeat

    @property
    def results(self) -> Results:
        """The results so far."""
        return Results(self._of.store, self._of.plan)

    def cancel(self) -> None:
        """Stop the campaign; its finished rows stay, and submitting it again continues it."""
        cancel_campaign(self._of.store, self.id)

    def wait(self) -> Results:
        """Wait until all rows are computed, and return them."""
        while not (seen := self._look()).is_over:
            self._follower.tell()
            time.sleep(_PAUSE)
        self._follower.tell()
        return self._end(seen)

    def __await__(self) -> Generator[Any, None, Results]:
        return self._awaited().__await__()

    async def _awaited(self) -> Results:
        while not (seen := await asyncio.to_thread(self._look)).is_over:
            self._follower.tell()
            await asyncio.sleep(_PAUSE)
        self._follower.tell()
        return await asyncio.to_thread(self._end, seen)

    def _look(self) -> Observation:
        """Observe the campaign; CampaignError if its coordinator has ended and left it queued or running."""
        seen = self._follower.look()
        # looked at again: it may have written its last state meanwhile
        if seen.state == "queued" and self._is_forsaken() and self._follower.look().state == "queued":
            why = f"; why: {self._assignment.log}" if self._assignment.log else ""
            raise CampaignError(f"{self.id}: its coordinator ended before it began{why}; submit it again")
        # only of one on another machine: the state of others is then "interrupted"
        if seen.state == "running" and seen.sign is not None and seen.sign.token and _is_lost(seen.sign):
            said = seen.heartbeat.waits_for if seen.heartbeat else "its coordinator has written nothing yet"
            raise CampaignError(f"{self.id}: {said}; submit it again to continue it")
        return seen

    def _is_forsaken(self) -> bool:
        """Return whether the coordinator that it was handed to has ended."""
        if self._assignment.kind == "service":
            lease, beat = (self._of.store.read_json(SERVICE, name) for name in (LEASE, HEARTBEAT))
            self._service = judge_life(lease, beat, self._service, time.monotonic())
            return _is_lost(self._service)
        if self._assignment.pid is not None:
            return _has_ended(self._assignment.pid)
        # somebody held its lease then, perhaps only to write a report
        return self._assignment.kind == "coordinator" and not is_coordinated(self._of.store, self.id)

    def _end(self, seen: Observation) -> Results:
        """Return the results of a campaign that is over; CampaignError unless it is completed."""
        results = self.results
        if seen.state != "completed":
            why = f": {seen.message}" if seen.message else ""
            raise CampaignError(f"{self.id} is {seen.state}{why}; submit it again to continue it")
        if lack := lack_of_ok(results.plan, results.statuses):
            warnings.warn(lack, stacklevel=3)
        return results

    def __repr__(self) -> str:
        """Return id, state and progress in a line."""
        return f"<RunningCampaign {self.id}: {self._words()}>"

    def _repr_html_(self) -> str:
        return "<br>".join(map(escape, (self._of.plan.title, f"campaign {self.id}", self._words())))

    def _words(self) -> str:
        seen = observe(self._of.store, self.id)
        done = 0 if seen.heartbeat is None else seen.heartbeat.done
        return f"{seen.state}, {done} of {self._of.plan.spec.samples} runs"


def submit_campaign(
    campaign: "Source | Campaign",
    *,
    samples: int | None = None,
    seed: int | None = None,
    store: str | Path = "runs",
    workers: int | None = None,
    cluster: "Cluster | Client | None" = None,
    progress: Progress = False,
    rows: Rows | None = None,
) -> RunningCampaign:
    """Hand a campaign to a coordinator in the background and return; it goes on when this program ends.

    The coordinator that serves the store computes it, or one that is started for it, as with ``clearcap submit``. When
    all rows are computed, it decides verdicts that are open and writes the report.

    Parameters
    ----------
    campaign, samples, seed, store, workers, cluster
        As in `run_campaign`.
    progress, rows : callable, optional
        As in `RunningCampaign`, called where the campaign is awaited.

    Returns
    -------
    RunningCampaign
        ``await`` it, or call its ``wait``.

    Raises
    ------
    SpecError, StoreError
        If the campaign, the address of the store or the cluster is wrong, or the store cannot be written.
    """
    opened, plan, options = planned(campaign, samples, seed, store, workers, cluster)
    running = RunningCampaign(Results(opened, plan), progress, rows)
    running._assignment = assign_coordinator(opened, plan, options)
    return running


def _has_ended(pid: int) -> bool:
    """Return whether a process that this one started has ended."""
    with suppress(ChildProcessError):  # its end was noticed before
        os.waitpid(pid, os.WNOHANG)
    return started(pid) is None


def _is_lost(sign: SignOfLife) -> bool:
    """Return whether a coordinator has ended: here that is known at once, elsewhere after minutes of silence."""
    return sign.is_alive is False and (sign.heartbeat is None or time.monotonic() - sign.seen_at > _SILENCE)
