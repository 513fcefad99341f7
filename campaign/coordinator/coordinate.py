"""Coordinate a campaign to its end: hold its lease, connect to the cluster, compute, and record how it ended."""

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass

from campaign.cluster.cluster import Cluster
from campaign.cluster.dask_workers import connect_workers
from campaign.cluster.workers import Workers
from campaign.coordinator.compile_first import compile_first
from campaign.coordinator.coordinator import Coordinator
from campaign.coordinator.failed_runs import lack_of_ok
from campaign.coordinator.heartbeat import Show
from campaign.coordinator.lease import LeaseLost, hold_lease
from campaign.coordinator.state import write_state
from campaign.coordinator.stopping_rule import Verdict
from campaign.errors import StoreError, UnreachableError
from campaign.plan import Plan
from campaign.store import Store, Survey
from campaign.worker.messages import Cancelled, Simulate, check_build
from engine import simulate

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Outcome:
    """The result of a completed campaign."""

    plan: Plan
    survey: Survey  # of the store at the end
    samples: int  # as planned, or fewer if the stopping rule ended the campaign
    computed: int  # rows that this call computed; the store already had the others
    wall_s: float  # of the call [s]
    verdict: Verdict | None = None  # the last one of the stopping rule in this call; None if it was not evaluated


def coordinate(
    store: Store,
    plan: Plan,
    cluster: Cluster,
    show: Show = lambda _: None,
    simulate: Simulate = simulate,
    *,
    is_served: bool = False,
    report_due: bool = False,
    connect: Callable[[Cluster], AbstractContextManager[Workers]] | None = None,
) -> Outcome:
    """Compute the missing rows of a campaign; at the end there is a row for every sample.

    A service that computes it (``is_served``) leaves it open for the next one if Ctrl-C ends it, and at its end too if
    it still has to write the report (``report_due``). Raises LeaseHeld or LeaseLost, Cancelled, WrongBuild if rows are
    missing, TooManyFailed, StoreError or UnreachableError; stored rows stay, and another call continues from there.
    """
    start = time.perf_counter()
    with hold_lease(store, plan.campaign_id) as token:
        store.plan_header(plan.campaign_id)  # it may have been deleted since; from now on it cannot be
        write_state(store, plan.campaign_id, "running")
        try:
            coordinator = Coordinator(store, plan, token, show, simulate)
            coordinator.run(lambda: _ready_workers(plan, cluster, simulate, connect or connect_workers))
        except BaseException as error:
            _write_failure(store, plan.campaign_id, error, is_served=is_served)
            raise
        verdict = coordinator.checkpoints.verdict
        survey = store.survey(plan)
        message = "; ".join(filter(None, (lack_of_ok(plan, survey.statuses), verdict.text() if verdict else "")))
        coordinator.publish_heartbeat("completed")  # before the state, for clients that watch until this state
        write_state(store, plan.campaign_id, "completed", message, is_open=report_due)
    wall = time.perf_counter() - start
    return Outcome(plan, survey, store.end(plan), coordinator.progress.computed, wall, verdict)


@contextmanager
def _ready_workers(
    plan: Plan, cluster: Cluster, simulated: Simulate, connect: Callable[[Cluster], AbstractContextManager[Workers]]
) -> Iterator[Workers]:
    """Connect to the workers; on this machine, one worker compiles the engine first and the others load the result."""
    if cluster.starts_here:
        # before workers are started; those elsewhere check their own build with each batch
        check_build(plan.campaign_id, plan.row_build)
    with connect(cluster) as workers:
        if cluster.starts_here and simulated is simulate:
            compile_first(workers)
        yield workers


def _write_failure(store: Store, campaign_id: str, error: BaseException, *, is_served: bool) -> None:
    """Record how a campaign ended; a failure to write this must not hide the original error.

    A campaign that a supervisor, the store or the cluster ended stays open for the next coordinator; a campaign ended
    by Ctrl-C stays open if a service was computing it.
    """
    if isinstance(error, LeaseLost):
        return
    is_interrupted = isinstance(error, KeyboardInterrupt)
    is_open = isinstance(error, SystemExit | StoreError | UnreachableError) or (is_interrupted and is_served)
    state = "cancelled" if isinstance(error, Cancelled) else "failed"
    state = "interrupted" if is_open or is_interrupted else state
    # The text of SystemExit is only a number, and for a cancelled campaign the state says everything.
    message = "" if isinstance(error, SystemExit | Cancelled) else str(error)
    with suppress(StoreError):
        write_state(store.hasty, campaign_id, state, message, is_open=is_open)
