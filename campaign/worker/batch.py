"""What a worker does: compute one batch and write its part. Only counts travel back.

Whatever happens in a run, the answer is a row. A run that ends its process takes the batch with it; the batch is then
computed again in an isolated subprocess (`campaign.worker.subprocess_runs`), so the run at fault becomes a row too.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from time import perf_counter

from campaign.errors import CampaignError
from campaign.plan import Plan
from campaign.store import BadPart, Part, Store, open_store
from campaign.store.layout import CANCEL
from campaign.worker.limits import cancelled_by, memory_limit
from campaign.worker.moments import Moments, moments
from campaign.worker.row import Row, Simulate, compute_row, inputs, rows_to_table
from engine import build_id, simulate, warm_up


class WrongBuild(CampaignError):
    """A worker has another engine than the campaign is planned for.

    Attributes
    ----------
    worker : str
        Its address; empty in a process that is no worker.
    """

    worker = ""


class Cancelled(CampaignError):
    """The campaign was cancelled while the batch was computed."""

    exit_code = 3


@dataclass(frozen=True)
class Task:
    """A campaign, addressed: small enough to travel, complete enough to be computed anywhere.

    Attributes
    ----------
    store : str
        URL of the store.
    campaign_id : str
        Whose plan to follow.
    engine_build : str
        The build of the engine that the plan is for.
    simulate : callable
        `engine.simulate`, or what stands in its place: a function of a module, of the same face.
    """

    store: str
    campaign_id: str
    engine_build: str
    simulate: Simulate = simulate


@dataclass(frozen=True)
class Order:
    """A batch to compute.

    Attributes
    ----------
    batch : int
        Which.
    attempt : int
        The how manieth time it is asked for.
    apart : bool
        Whether its runs get a process of their own, because it took its worker with it.
    """

    batch: int
    attempt: int = 1
    apart: bool = False


@dataclass(frozen=True)
class Done:
    """What a task reports.

    Attributes
    ----------
    part : Part
        What was written.
    moments : dict of str to Moments
        Of each response.
    computed : bool
        Whether it was computed now; otherwise it was there.
    seconds : float
        How long it took [s].
    """

    part: Part
    moments: dict[str, Moments] = field(default_factory=dict)
    computed: bool = True
    seconds: float = 0.0


def run_batches(task: Task, orders: Sequence[Order]) -> list[Done]:
    """Compute batches one after the other; errors as of `run_batch`, and what is written before one stays."""
    return [run_batch(task, order) for order in orders]


def run_batch(task: Task, order: Order) -> Done:
    """Compute a batch and write its part, unless it is there.

    Raises
    ------
    WrongBuild
        If this process runs another engine build than the plan is for.
    Cancelled
        If the campaign was cancelled meanwhile.
    StoreError
        If the store fails.
    """
    store, plan = opened(task)
    start = perf_counter()
    try:
        table, computed = store.read_own_part(plan, order.batch), False
    except (FileNotFoundError, BadPart):
        first, count = plan.batches[order.batch]
        samples = range(first, first + count)
        table, computed = rows_to_table(plan, list(_rows(task, samples, order))), True
    part = store.write_part(plan, order.batch, table)
    return Done(part, moments(table, plan.mechanism.responses), computed, perf_counter() - start)


def _rows(task: Task, samples: Sequence[int], order: Order) -> Iterator[Row]:
    from campaign.worker.subprocess_runs import rows_apart

    compute = rows_apart if order.apart else rows_here
    return compute(task, samples, order.attempt)


def rows_here(task: Task, samples: Sequence[int], attempt: int = 1) -> Iterator[Row]:
    """Compute rows of samples of a batch in this process, one after the other.

    Raises
    ------
    Cancelled
        If the campaign was cancelled meanwhile.
    """
    from engine.loop import Cancel

    store, plan = opened(task)
    cancel = Cancel()
    marker = f"{plan.campaign_id}/{CANCEL}"
    with memory_limit(plan.spec.execution.memory_limit), cancelled_by(lambda: store.files.exists(marker), cancel):
        for sample, values in inputs(plan, samples):
            row = compute_row(plan, task.simulate, sample, values, attempt, cancel)
            if cancel.flag[0]:
                raise Cancelled(f"campaign {plan.campaign_id} is cancelled")
            yield row


@lru_cache(maxsize=4)
def opened(task: Task) -> tuple[Store, Plan]:
    """Return the store and the plan of a task, read once a process, the engine compiled.

    Raises
    ------
    WrongBuild
        If this process runs another engine build than the plan is for.
    """
    if build_id() != task.engine_build:
        error = WrongBuild(
            f"campaign {task.campaign_id} is planned for engine build {task.engine_build}, this process runs"
            f" {build_id()}; install that version here, or run the campaign anew"
        )
        error.worker = _worker()
        raise error
    if task.simulate is simulate:
        warm_up()  # before any clock runs
    store = open_store(task.store)
    return store, store.plan(task.campaign_id)


def _worker() -> str:
    """Return the address of the worker this is; empty in any other process."""
    from distributed import get_worker

    try:
        return str(get_worker().address)  # type: ignore[no-untyped-call]
    except ValueError:
        return ""
