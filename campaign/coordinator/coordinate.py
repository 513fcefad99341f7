"""Coordinate a campaign to its end: hold its lease, connect to workers, dispatch batches, record how it ended.

Failures are handled as follows:

- a run fails: it becomes a row with its status, and the other runs go on;
- a batch kills its worker, or the worker hangs: the batch is computed again with its runs in an isolated subprocess;
- a worker has another build: it gets no more batches, and a message names it;
- the store fails: operations on it are tried again for minutes while batches go on as far as possible; finally the
  campaign pauses with a message;
- the scheduler is lost: the coordinator connects again, surveys the store, and goes on.
"""

import logging
import os
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import partial

from campaign.cluster.cluster import Cluster
from campaign.cluster.workers import (
    SchedulerLost,
    WorkerDied,
    Workers,
    compile_first,
    connect_workers,
    worker_of,
)
from campaign.coordinator.dispatch import TRIES, Losses, Window, WorkQueue, isolated
from campaign.coordinator.failed_runs import check_failures, lack_of_ok
from campaign.coordinator.heartbeat import Heartbeat, Progress, Show
from campaign.coordinator.lease import HEARTBEAT_INTERVAL, LeaseLost, check_lease, hold_lease
from campaign.coordinator.state import resume_command, write_state
from campaign.coordinator.stopping_rule import Checkpoints, Verdict
from campaign.errors import CampaignError, StoreError, UnreachableError
from campaign.plan import Plan
from campaign.processes import ProcessName, meanwhile
from campaign.store import Part, Store, Survey
from campaign.store.files.retry_policy import Outage
from campaign.store.layout import CANCEL, HEARTBEAT
from campaign.store.parts import folder
from campaign.store.store import repeat_plans, repeated_shares, survey_repeats
from campaign.waits import Wait, Waits
from campaign.worker.messages import (
    BatchRequest,
    BatchResult,
    CampaignAddress,
    Cancelled,
    Simulate,
    WrongBuild,
    check_build,
    moments,
)
from engine import simulate

RECONNECTS_FOR = 600.0  # s after the scheduler was lost
STEADY_AFTER = 60.0  # s after which a connection has held, even if no call has finished
PROBE_EVERY = 10.0  # s between two questions to the store whether it takes a file, while nothing finishes
PROBE = "probe.bin"
PROBE_BYTES = 65_536  # as large as a part; a heartbeat may find room where no part does
RECORD_INTERVAL = 30.0  # s between two manifests, which only save time
RECORD_SHARE = 0.02  # the most of its time that a coordinator spends on them: that of 200,000 batches takes seconds
MANY_FILES = 1000  # of rows, beyond which they are merged at the end
STORE_TRIES = 3  # workers in a row for which the store fails, each after trying for minutes

logger = logging.getLogger(__name__)

Connect = Callable[[], AbstractContextManager[Workers]]


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
    """Compute the missing rows of a campaign; at the end there is a row for every sample."""
    # A service that computes it (``is_served``) leaves it open for the next one if Ctrl-C ends it, and at its end too
    # if it still has to write the report (``report_due``). Whatever it raises, stored rows stay, and another call goes
    # on.
    start = time.perf_counter()
    with hold_lease(store, plan.campaign_id) as token:
        store.plan_header(plan.campaign_id)  # it may have been deleted since; from now on it cannot be
        options = cluster.options()
        write_state(store, plan.campaign_id, "running", options=options)
        try:
            coordinator = Coordinator(store, plan, token, show, simulate)
            ready = partial(_ready_workers, plan, cluster, simulate, connect or connect_workers, coordinator.waits)
            coordinator.run(ready)
        except BaseException as error:
            _write_failure(store, plan.campaign_id, error, options, is_served=is_served)
            raise
        _merge_small_files(store, plan)
        verdict = coordinator.checkpoints.verdict
        survey = store.survey(plan)
        message = "; ".join(filter(None, (lack_of_ok(plan, survey.statuses), verdict.text() if verdict else "")))
        coordinator.publish_heartbeat("completed")  # before the state, for clients that watch until this state
        write_state(store, plan.campaign_id, "completed", message, is_open=report_due, options=options)
    wall = time.perf_counter() - start
    return Outcome(plan, survey, store.end(plan), coordinator.progress.computed, wall, verdict)


@contextmanager
def _ready_workers(
    plan: Plan,
    cluster: Cluster,
    simulated: Simulate,
    connect: Callable[[Cluster], AbstractContextManager[Workers]],
    waits: Waits,
) -> Iterator[Workers]:
    """Connect to the workers; on this machine, one worker compiles the engine first and the others load the result."""
    if cluster.starts_here:
        # before workers are started; those elsewhere check their own build with each batch
        check_build(plan.campaign_id, plan.row_build)
    with connect(cluster) as workers:
        if cluster.starts_here and simulated is simulate:
            with waits.during("compiling"):
                compile_first(workers)
        yield workers


def _merge_small_files(store: Store, plan: Plan) -> None:
    """Merge the files of a completed campaign if they are many: each costs every later reader a millisecond or two."""
    files = len(store.files.names(folder(plan)))
    if files > MANY_FILES:
        logger.info("merging %d files of rows into larger ones", files)
        try:
            store.compact(plan)
        except StoreError as error:  # the rows are there all the same
            logger.warning("%s; to merge them later: %s", error, store.command("compact", plan.campaign_id))


def _write_failure(
    store: Store, campaign_id: str, error: BaseException, options: list[str], *, is_served: bool
) -> None:
    """Record how a campaign ended; a failure to write this must not hide the original error."""
    # It stays open for the next coordinator if a supervisor, the store or the cluster ended it, or Ctrl-C a service.
    if isinstance(error, LeaseLost):
        return
    is_interrupted = isinstance(error, KeyboardInterrupt)
    is_open = isinstance(error, SystemExit | StoreError | UnreachableError) or (is_interrupted and is_served)
    state = "cancelled" if isinstance(error, Cancelled) else "failed"
    state = "interrupted" if is_open or is_interrupted else state
    # The text of SystemExit is only a number, and for a cancelled campaign the state says everything.
    message = "" if isinstance(error, SystemExit | Cancelled) else str(error)
    with suppress(StoreError):
        write_state(store.hasty, campaign_id, state, message, is_open=is_open, options=options)


class Coordinator:
    """Compute the missing batches of a campaign on workers, and publish its progress; ``token`` is the lease's."""

    def __init__(self, store: Store, plan: Plan, token: str, show: Show, simulate: Simulate = simulate) -> None:
        self.store, self.plan = store, plan
        self.repeats = repeat_plans(store, plan)
        self.address = CampaignAddress.of(store, plan, simulate, repeated_shares(store, plan))
        self.show = show
        # every file is read: only an intact part makes a batch done, and damage may keep the size of a file
        survey = self._survey(verify=True)
        self.progress = Progress(store, plan, survey)
        # after the progress, whose numbers of repeats this sets
        self.queue = self._queue_missing(survey.parts)
        self.checkpoints = Checkpoints(store, plan)
        self.waits = Waits()
        self._waits_of_workers: list[Wait] = []
        self._token = token
        self._heartbeats = 0
        self._outage = Outage(store.url, store.files.retry_policy)
        self._store_failures = 0  # successive failures that workers reported
        self._finished = 0  # calls
        self._probed_at = 0.0
        self._record_at = 0.0  # not before, by a monotonic clock [s]

    def run(self, connect: Connect) -> None:
        """Compute until the store has all batches, also those damaged meanwhile; ``connect`` again after each loss."""
        self._stop_at_checkpoint()
        # each round ends with reading all files again; on a disk that keeps damaging them, no round would be the last
        for _ in range(TRIES):
            if not self.queue:
                break
            self._compute_through_losses(connect)
            self.queue.record(self.store)
            self._rescan(verify=True)
        else:
            raise StoreError(
                f"store {self.store.url}: part files were damaged after they were written, {TRIES} times in a row;"
                " check the disk"
            )
        check_lease(self.store, self.plan.campaign_id, self._token)
        self.queue.record(self.store)
        for name in (self.plan.campaign_id, *map(folder, (self.plan, *self.repeats))):
            self.store.files.sweep(name)  # temporary files of killed workers

    def compute(self, workers: Workers) -> None:
        """Keep batches in flight until all are completed, or the stopping rule ends the campaign."""
        window = Window(workers, self.address)
        next_check = time.monotonic()
        try:
            while True:
                # enough batches beyond the checkpoint to keep all workers busy; more would be lost if the campaign ends
                # there
                self.checkpoints.limit(self.queue, window.size)
                window.fill(self.queue)
                if not window:
                    return
                if time.monotonic() >= next_check:
                    self._check(window)
                    next_check = time.monotonic() + HEARTBEAT_INTERVAL
                finished = window.next_finished(next_check - time.monotonic())
                if finished is None:
                    continue
                self._finished += 1
                self._handle_result(window, *finished)
                if self._stop_at_checkpoint():
                    return
        finally:
            workers.cancel()  # however it ended, nobody waits for the calls in flight any more

    def publish_heartbeat(self, state: str, store: Store | None = None) -> None:
        """Show the progress of the campaign and write it into the store."""
        heartbeat = self._heartbeat(state)
        self.show(heartbeat)
        (store or self.store).write_json(self.plan.campaign_id, HEARTBEAT, heartbeat.to_json())

    def _heartbeat(self, state: str) -> Heartbeat:
        self._heartbeats += 1
        waits = [*self.waits, *self._waits_of_workers]
        return self.progress.heartbeat(state, waits, token=self._token, beat=self._heartbeats, pid=os.getpid())

    def _compute_through_losses(self, connect: Connect) -> None:
        """Connect and compute; connect again if the scheduler is lost."""
        losses = Losses()
        while self.queue:
            connected_at, finished = None, self._finished
            try:
                with ExitStack() as stack:
                    with self._beating("scheduler" if losses else "start"):
                        workers = stack.enter_context(connect())
                    connected_at = time.monotonic()
                    self.compute(workers)
            except UnreachableError as error:
                held = connected_at is not None and time.monotonic() - connected_at > STEADY_AFTER
                if held or self._finished > finished:
                    losses.end()
                if not losses and not isinstance(error, SchedulerLost):
                    raise  # it was never reached, so there is nothing to reconnect to
                pause = losses.lose()
                if losses.seconds > RECONNECTS_FOR:
                    raise UnreachableError(
                        f"{error}; gave up after {RECONNECTS_FOR:.0f} s; finished rows are kept"
                    ) from error
                logger.warning("lost the scheduler (%s); reconnecting", error)
                self.progress.workers, self._waits_of_workers = 0, []
                self.waits.begin("scheduler", error, losses.seconds)
                self._pause(pause)
                self._rescan()

    def _pause(self, seconds: float) -> None:
        """Wait without letting the lease become stale; raises what `_look_at_store` raises."""
        end = time.monotonic() + seconds
        self._look_at_store()
        while (left := end - time.monotonic()) > 0.0:
            time.sleep(min(left, HEARTBEAT_INTERVAL))
            self._look_at_store()

    @contextmanager
    def _beating(self, what: str) -> Iterator[None]:
        """Publish heartbeats from a thread during a block in which this one waits for workers, perhaps for minutes."""

        def beat(over: threading.Event) -> None:
            while not over.wait(HEARTBEAT_INTERVAL):
                try:
                    self._look_at_store()
                except CampaignError:
                    return  # the next check in the thread that waits raises it again

        with self.waits.during(what), meanwhile(beat, "heartbeats"):
            yield

    def _check(self, window: Window) -> None:
        """Check workers and store; called every two seconds."""
        self._waits_of_workers = window.look(len(self.queue))
        self.progress.workers = window.worker_count
        self._look_at_store()

    def _look_at_store(self) -> None:
        """Check the store, without waiting for one that fails: batches go on, until it has failed for too long."""
        try:
            self._check_store(self.store.hasty)
        except StoreError as error:
            if self._outage.too_long:
                raise
            self._outage.begin(error)
            self.waits.begin("store", error)
            self.show(self._heartbeat("running"))  # at least to the one who is here
        else:
            self._outage.end()
            self.waits.end("store")

    def _check_store(self, store: Store) -> None:
        """Check cancellation and lease, publish a heartbeat, and record the manifest."""
        campaign_id = self.plan.campaign_id
        if store.files.exists(f"{campaign_id}/{CANCEL}"):
            raise Cancelled(
                f"campaign {campaign_id} is cancelled; continue it with: {resume_command(store, campaign_id)}"
            )
        # before the heartbeat, which would replace that of a process that has taken over
        check_lease(store, campaign_id, self._token)
        self.publish_heartbeat("running", store)
        self._probe(store)
        began = time.monotonic()
        if began > self._record_at:
            self.queue.record(store)
            now = time.monotonic()
            self._record_at = now + max(RECORD_INTERVAL, (now - began) / RECORD_SHARE)

    def _probe(self, store: Store) -> None:
        """If nothing finishes, write a file as large as a part: a disk without room for one may have it for others."""
        # A worker whose part the store refuses tries for minutes before it gives up.
        now = time.monotonic()
        if not self.progress.is_stalled or now - self._probed_at < PROBE_EVERY:
            return
        name = f"{self.plan.campaign_id}/{PROBE}"
        store.files.write(name, bytes(PROBE_BYTES))
        store.files.remove(name)
        self._probed_at = now

    def _handle_result(self, window: Window, requests: list[BatchRequest], future: Future[list[BatchResult]]) -> None:
        """Record the batches of a finished call, or requeue them for another attempt."""
        try:
            results = future.result()
        except WorkerDied as error:
            logger.warning(
                "%s was given to %s; its runs are repeated in a process of their own", _text(requests), error
            )
            self.queue.requeue([isolated(request) for request in requests])
        except WrongBuild as error:
            if worker := window.refuse(future):  # once, however many calls it had
                logger.warning("worker %s: %s; it gets no more batches", worker, error)
            self.queue.requeue(requests)
        except Cancelled:
            self.queue.requeue(requests)  # the next check finds the marker and ends the campaign
        except (StoreError, OSError) as error:
            self.queue.requeue(requests)
            self._store_failures += 1
            if self._store_failures >= STORE_TRIES:
                raise StoreError(f"{_text(requests)}: {error}") from error
            logger.warning("%s is computed again, because its worker gave up: %s", _text(requests), error)
        except Exception as error:
            raise CampaignError(f"{_text(requests)} cannot be computed: {type(error).__name__}: {error}") from error
        else:
            self._record(window, results, worker_of(future))

    def _record(self, window: Window, results: list[BatchResult], worker: ProcessName | None) -> None:
        """Count batches whose rows are in the store, and who computed them."""
        self._store_failures = 0
        for result in results:
            if result.part is not None:
                self.queue.complete(result.part)
            self.progress.add(result, worker)
        # the slowest one: no call shall take longer than it may, see `Window`
        window.batch_seconds = max((r.seconds for r in results if r.computed), default=window.batch_seconds)
        check_failures(self.store, self.plan, self.progress)

    def _stop_at_checkpoint(self) -> bool:
        """Evaluate the stopping rule if a checkpoint is complete; return whether the campaign ends there."""
        if not self.checkpoints.reached_end(self.queue):
            return False
        self.queue = self._queue_missing(self.queue.parts)
        # the rows after the end, which were computed ahead, no longer count
        self.progress.recount(self.store, self.store.survey(self.plan))
        return True

    def _rescan(self, *, verify: bool = False) -> None:
        """Survey the store anew, and forget the calls in flight."""
        survey = self._survey(verify=verify)
        if self.queue.parts.keys() <= survey.parts.keys():
            needed = range(self.plan.batches_before(self.store.end(self.plan)))
            for batch in (survey.parts.keys() - self.queue.parts.keys()).intersection(needed):
                rows = self.store.read_part(self.plan, batch)  # written while the connection was lost
                moments_of = moments(rows, self.plan.mechanism.responses)
                self.progress.add(BatchResult(survey.parts[batch], moments_of, computed=False))
        else:
            # rows were lost, and moments can only be added to
            self.progress.recount(self.store, survey)
        self.queue = self._queue_missing(survey.parts)
        self._stop_at_checkpoint()

    def _queue_missing(self, parts: Mapping[int, Part]) -> WorkQueue:
        """Return the batches with missing rows or repeats; quarantine damaged files of repeats."""
        repeats = survey_repeats(self.store, self.repeats, verify=True, mend=True)
        self.progress.repeats, self.progress.repeated = repeats.planned, repeats.done
        return WorkQueue(self.plan, parts, self.store.end(self.plan), repeats.missing)

    def _survey(self, *, verify: bool) -> Survey:
        """Return the parts and rows that the store holds; quarantine damaged files."""
        survey = self.store.survey(self.plan, verify=verify)
        self.store.quarantine(self.plan, survey.bad)
        return survey


def _text(requests: list[BatchRequest]) -> str:
    first, last = requests[0].batch, requests[-1].batch
    return f"batch {first}" if first == last else f"one of batches {first} to {last}"
