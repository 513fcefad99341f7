"""Drive a campaign to its end: what is missing is computed on workers; the store says what is missing.

The one dask client. It keeps a bounded window of batches in flight, releases each future on arrival, and after any
loss connects anew and looks into the store. What happens when something fails:

- a run fails: a row with its status; the others go on;
- a batch takes its worker with it: it is computed again with a process for its runs alone;
- a worker has another engine build: it gets no more batches, and its name is said;
- the store fails: the batch is tried again a few times, ever more rarely, then the campaign pauses with a message;
- the scheduler is lost: connect anew, scan the store, go on.
"""

import logging
import time
from contextlib import suppress
from dataclasses import dataclass

from distributed import Client

from campaign.cluster.cluster import Cluster
from campaign.cluster.connect import connect
from campaign.coordinator.dispatch import beat, compute, look_for_checkpoint
from campaign.coordinator.heartbeat import Progress
from campaign.coordinator.lease import LeaseLost, hold_lease
from campaign.coordinator.results import TRIES, Drive, Lost, Show, pause
from campaign.coordinator.state import write_state
from campaign.coordinator.stopping_rule import Verdict
from campaign.coordinator.work_queue import WorkQueue
from campaign.errors import StoreError, UnreachableError
from campaign.plan import Plan
from campaign.store import Store, Survey
from campaign.store.layout import PARTS, STOPPED
from campaign.worker.messages import BatchResult, CampaignAddress, Cancelled, Simulate
from campaign.worker.moments import moments
from engine import simulate, warm_up

logger = logging.getLogger(__name__)

LOADS_WITHIN = 4.0  # s: an engine that takes longer is not in the cache
RECONNECTS_FOR = 600.0  # s, after a scheduler was lost


@dataclass(frozen=True)
class Outcome:
    """A campaign that has been driven to its end.

    Attributes
    ----------
    plan : Plan
        What was computed.
    survey : Survey
        What the store holds.
    samples : int
        How many samples the campaign has: those planned, or fewer if it stopped when sure.
    computed : int
        Rows computed by this call; the others were there.
    wall_s : float
        How long it took [s].
    verdict : Verdict or None
        Of the stopping rule, if there is one.
    """

    plan: Plan
    survey: Survey
    samples: int
    computed: int
    wall_s: float
    verdict: Verdict | None = None


def coordinate(
    store: Store,
    plan: Plan,
    cluster: Cluster,
    show: Show = lambda _: None,
    simulate: Simulate = simulate,
    *,
    report_due: bool = False,
) -> Outcome:
    """Compute what is missing of a campaign.

    Parameters
    ----------
    store : Store
        Where the plan is and the rows go.
    plan : Plan
        What to compute.
    cluster : Cluster
        Where to compute it.
    show : callable
        Told every two seconds how far the campaign is.
    simulate : callable
        `engine.simulate`, or what stands in its place.
    report_due : bool
        Leave the campaign open at its end, for a service that still has to write its report and may be killed in it.

    Returns
    -------
    Outcome
        With a row for every sample.

    Raises
    ------
    LeaseHeld, LeaseLost
        If another process drives the campaign.
    Cancelled
        If the campaign was cancelled.
    TooManyFailed
        If more runs failed than its policy allows.
    StoreError, UnreachableError
        If the store or the cluster fails and stays so; what the store holds stays.
    KeyboardInterrupt
        On Ctrl-C; coordinating the campaign again goes on from there.
    """
    start = time.perf_counter()
    with hold_lease(store, plan.campaign_id) as token:
        write_state(store, plan.campaign_id, "running")
        try:
            task = CampaignAddress.of(store, plan, simulate)
            drive = _begin(store, plan, task, token, show)
            _to_the_end(drive, cluster)
        except BaseException as error:
            _end(store, plan.campaign_id, error)
            raise
        told = drive.verdict.text() if drive.verdict else ""
        write_state(store, plan.campaign_id, "completed", told, to_go_on=report_due)
        beat(drive, "completed")
    wall = time.perf_counter() - start
    survey = store.survey(plan)
    return Outcome(plan, survey, store.end(plan), drive.ledger.computed, wall, drive.verdict)


def _begin(store: Store, plan: Plan, task: CampaignAddress, token: str, show: Show) -> Drive:
    """Look at what is there, every part of it; what is not sound is quarantined."""
    survey = store.survey(plan, verify=True)
    store.quarantine(plan, survey.bad)
    ledger = Progress(store, plan, survey)
    queue = WorkQueue(plan, survey.parts, store.end(plan))
    drive = Drive(store, plan, task, ledger, dict(survey.parts), queue, token, show)
    if plan.spec.stop and not store.read_json(plan.campaign_id, STOPPED):
        drive.checkpoints = list(plan.spec.stop.checkpoints(plan.spec.samples))
    return drive


def _to_the_end(drive: Drive, cluster: Cluster) -> None:
    """Compute until nothing is missing; what was damaged meanwhile is computed again."""
    look_for_checkpoint(drive)
    for _ in range(TRIES):
        if not drive.queue:
            break
        _through_losses(drive, cluster)
        drive.store.record(drive.plan, drive.parts.values())
        _rescan(drive, verify=True)
    else:
        raise StoreError(
            f"store {drive.store.url}: parts that were written whole are damaged when they are read, {TRIES} times in a"
            " row; check the disk"
        )
    drive.store.record(drive.plan, drive.parts.values())
    drive.store.files.sweep(f"{drive.plan.campaign_id}/{PARTS}")


def _through_losses(drive: Drive, cluster: Cluster) -> None:
    """Connect and compute what is missing; after a loss, connect anew."""
    lost_at: float | None = None
    losses = 0
    while drive.queue:
        try:
            with connect(cluster) as client:
                lost_at, losses = None, 0
                if cluster.scheduler is None and cluster.kind == "local":
                    _compile(client, drive.task)
                compute(drive, client)
        except (Lost, UnreachableError) as error:
            if lost_at is None and isinstance(error, UnreachableError):
                raise  # never reached: nothing to go on with
            lost_at = lost_at or time.monotonic()
            if time.monotonic() - lost_at > RECONNECTS_FOR:
                raise UnreachableError(f"{error}; gave up after {RECONNECTS_FOR:.0f} s, nothing is lost") from error
            logger.warning("lost the scheduler (%s); connecting anew", error)
            losses += 1
            time.sleep(pause(losses))
            beat(drive, "running")
            _rescan(drive)


def _rescan(drive: Drive, *, verify: bool = False) -> None:
    """Ask the store what is missing, forgetting what was in flight."""
    survey = drive.store.survey(drive.plan, verify=verify)
    drive.store.quarantine(drive.plan, survey.bad)
    if drive.parts.keys() <= survey.parts.keys():
        needed = range(drive.queue.batches_for(drive.store.end(drive.plan)))
        for batch in (survey.parts.keys() - drive.parts.keys()).intersection(needed):  # written while nobody listened
            rows = drive.store.read_part(drive.plan, batch)
            found = moments(rows, drive.plan.mechanism.responses)
            drive.ledger.add(BatchResult(survey.parts[batch], found, computed=False))
    else:
        drive.ledger.recount(drive.store, survey)
    drive.parts = dict(survey.parts)
    drive.queue = WorkQueue(drive.plan, survey.parts, drive.store.end(drive.plan))
    look_for_checkpoint(drive)


def _compile(client: Client, task: CampaignAddress) -> None:
    """Have one worker compile the engine, so that the others load what it compiled."""
    if task.simulate is not simulate:
        return
    compiled = client.submit(warm_up, pure=False)
    try:
        compiled.result(timeout=LOADS_WITHIN)
    except TimeoutError:
        logger.info("compiling the engine: once after each change of version, about a minute")
        compiled.result()


def _end(store: Store, campaign_id: str, error: BaseException) -> None:
    """Leave word of how it ended; a store that cannot take it is not to hide the error.

    What a supervisor ended, and what the store or the cluster ended, is open for the next coordinator.
    """
    to_go_on = isinstance(error, SystemExit | StoreError | UnreachableError)
    if isinstance(error, LeaseLost):
        return
    state = "cancelled" if isinstance(error, Cancelled) else "failed"
    state = "interrupted" if to_go_on or isinstance(error, KeyboardInterrupt) else state
    with suppress(StoreError):
        write_state(store, campaign_id, state, str(error), to_go_on=to_go_on)
