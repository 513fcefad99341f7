"""A campaign to its end: what is missing is computed on workers, the store says what is missing.

The failure rules: a run never stops the others; a worker that dies costs a repetition of its batch; a batch
that keeps killing workers is computed alone, then sample by sample, and the sample that kills becomes a
``crashed`` row.
"""

import logging
from collections import Counter, deque
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import get_context
from time import perf_counter

from distributed import Client, Future, KilledWorker, as_completed

from campaign.errors import StoreError
from campaign.load import Campaign
from campaign.local import interrupts_held, local_client
from campaign.plan import Plan, make_plan
from campaign.progress import Watcher
from campaign.store import Scan, Store, count_statuses
from campaign.task import Done, Row, Simulate, Task, crashed_row, rows_to_table, run_batch, run_sample
from engine import simulate, warm_up

logger = logging.getLogger(__name__)

BATCHES_PER_WORKER = 3  # in flight: one runs, one waits at the worker, one at the scheduler
LOADS_WITHIN = 4.0  # s: an engine that takes longer is not in the cache
ROUNDS = 3  # over what is still missing, before the store is called broken

OnDone = Callable[[Done], None]


@dataclass(frozen=True)
class Outcome:
    """A campaign that has been run to its end.

    Attributes
    ----------
    plan : Plan
        What was computed.
    scan : Scan
        What the store holds.
    computed : int
        Rows computed by this call; the others were there.
    wall_s : float
        How long it took [s].
    """

    plan: Plan
    scan: Scan
    computed: int
    wall_s: float

    @property
    def statuses(self) -> dict[str, int]:
        """Number of rows by status."""
        return count_statuses(self.scan)


def submit(store: Store, campaign: Campaign, batch_size: int | None = None) -> Plan:
    """Put the plan of a campaign into a store, or find the one that is there.

    Parameters
    ----------
    store : Store
        Where.
    campaign : Campaign
        What.
    batch_size : int, optional
        Of a new plan; a plan that is there keeps its own.
    """
    wanted = make_plan(campaign, batch_size)
    plan = store.create_plan(wanted)
    if batch_size is not None and plan.batches != wanted.batches:
        logger.warning("the campaign is planned already: its batches of %d samples are kept", plan.batches[0][1])
    return plan


def run_campaign(
    store: Store,
    plan: Plan,
    workers: int,
    watch: Callable[[int, int, int], Watcher],
    simulate: Simulate = simulate,
) -> Outcome:
    """Compute what is missing of a campaign.

    Parameters
    ----------
    store : Store
        Where the plan is and the rows go.
    plan : Plan
        What to compute.
    workers : int
        Number of processes.
    watch : callable
        Makes the watcher from the number of rows planned, there, and failed.
    simulate : callable
        `engine.simulate`, or what a test puts in its place.

    Returns
    -------
    Outcome
        With a row for every sample.

    Raises
    ------
    StoreError
        If the store fails; what it holds stays.
    KeyboardInterrupt
        On Ctrl-C; running the campaign again goes on from there.
    """
    start = perf_counter()
    scan = store.scan(plan)
    store.set_aside(plan, scan)
    present = scan.table.num_rows
    statuses = count_statuses(scan)
    task = Task(store.url, plan.campaign_id, plan.engine_build, simulate)
    with watch(plan.spec.samples, present, present - statuses.get("ok", 0)) as watcher:
        for _ in range(ROUNDS):
            if not scan.missing:
                break
            _compute(store, plan, task, scan.missing, workers, watcher)
            scan = store.scan(plan)
            store.set_aside(plan, scan)
    if scan.missing:
        raise StoreError(
            f"store {store.url}: {len(scan.missing)} batches were written and are not there;"
            " check the store, then run the same command again"
        )
    store.files.sweep(f"{plan.campaign_id}/parts")
    return Outcome(plan, scan, plan.spec.samples - present, perf_counter() - start)


def _compute(store: Store, plan: Plan, task: Task, missing: list[int], workers: int, watcher: Watcher) -> None:
    """Compute batches on local workers, and those that kill workers apart from the others."""

    def tell(done: Done) -> None:
        rows = sum(done["statuses"].values())
        watcher.advance(rows, rows - done["statuses"].get("ok", 0))

    processes = min(workers, len(missing))
    with local_client(processes) as client:
        _compile(client)
        suspects = drive(client, task, missing, BATCHES_PER_WORKER * processes, tell)
        guilty = [batch for batch in suspects if drive(client, task, [batch], 1, tell)]
    for batch in guilty:
        logger.warning("batch %d kills its worker: its samples are computed one by one", batch)
        tell(quarantine(store, plan, task, batch))


def _compile(client: Client) -> None:
    """Have one worker compile the engine, so that the others load what it compiled."""
    compiled = client.submit(warm_up, pure=False)
    try:
        compiled.result(timeout=LOADS_WITHIN)
    except TimeoutError:
        logger.info("compiling the engine: once after each change of version, about a minute")
        compiled.result()


def drive(client: Client, task: Task, batches: Iterable[int], window: int, tell: OnDone) -> list[int]:
    """Compute batches with at most ``window`` in flight.

    Parameters
    ----------
    client : Client
        Whose workers compute.
    task : Task
        What a worker needs to know.
    batches : iterable of int
        Which.
    window : int
        Most batches in flight.
    tell : callable
        Told what each batch reports.

    Returns
    -------
    list of int
        Batches in whose company workers died; guilty or not.
    """
    waiting, in_flight, suspects = deque(batches), {}, []

    def submit_next() -> Future[Done]:
        batch = waiting.popleft()
        future = client.submit(run_batch, task, batch, pure=False)
        in_flight[future.key] = batch
        return future

    first = [submit_next() for _ in range(min(window, len(waiting)))]
    completed = as_completed(first, loop=client.loop, raise_errors=False)  # type: ignore[no-untyped-call]
    for future in completed:
        batch = in_flight.pop(future.key)
        try:
            tell(future.result())
        except KilledWorker:
            suspects.append(batch)
        future.release()
        if waiting:
            completed.add(submit_next())  # type: ignore[no-untyped-call]
    return suspects


def quarantine(store: Store, plan: Plan, task: Task, batch: int) -> Done:
    """Compute a batch that kills its process, one sample at a time in a process of its own."""
    first, count = plan.batches[batch]
    rows: list[Row] = []
    pool = _one_process()
    try:
        for sample in range(first, first + count):
            try:
                with interrupts_held():
                    future = pool.submit(run_sample, task, sample, _ATTEMPTS)
                rows.append(future.result())
            except BrokenProcessPool:
                message = "the run killed its process; repeat it with clearcap simulate to see why"
                rows.append(crashed_row(plan, sample, message, _ATTEMPTS))
                pool.shutdown()
                pool = _one_process()
    finally:
        pool.shutdown(cancel_futures=True)
    store.write_part(plan, batch, rows_to_table(plan, rows))
    return {"batch": batch, "statuses": dict(Counter(row["status"] for row in rows))}


_ATTEMPTS = 3  # of a row from quarantine: with its window, with its batch alone, and by itself


def _one_process() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(1, mp_context=get_context("spawn"))
