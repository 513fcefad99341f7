"""What a worker does: compute one batch and write its part. Only counts travel back.

Whatever happens in a run, the answer is a row. A run that ends its process takes the batch with it; the batch is then
computed anew with a process for its runs alone (`campaign.apart`), so that the guilty run becomes a row too.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from math import isfinite, nan
from time import perf_counter
from typing import TYPE_CHECKING, Any

import pyarrow as pa

from campaign.errors import CampaignError
from campaign.limits import cancelled_by, memory_limit, time_limit
from campaign.plan import Plan
from campaign.policy import RETRIED, Simulation
from campaign.running import Moments, moments
from campaign.sampling import draw
from campaign.store import BadPart, Part, Store, open_store
from engine import build_id, simulate, warm_up
from engine.mechanism import Mechanism
from engine.simulate import Run

if TYPE_CHECKING:
    from engine.loop import Cancel

Simulate = Callable[..., Run]
Row = dict[str, Any]

CANCEL = "cancel"  # the marker in a campaign's folder


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
    from campaign.apart import rows_apart

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


def compute_row(
    plan: Plan, simulate: Simulate, sample: int, values: Mapping[str, float], attempt: int, cancel: "Cancel"
) -> Row:
    """Simulate one sample, again with the settings of the retry policy if it fails; the answer is a row.

    Parameters
    ----------
    plan : Plan
        The campaign.
    simulate : callable
        `engine.simulate`, or what stands in its place.
    sample : int
        Its number.
    values : mapping of str to float
        Its inputs by variable name.
    attempt : int
        The how manieth attempt the first one is.
    cancel : Cancel
        Set from outside to end it.
    """
    earlier: list[str] = []
    for settings in (plan.spec.simulation, *plan.spec.failures.retry):
        row = _attempt(plan, simulate, sample, values, settings, cancel)
        row |= {"attempts": attempt + len(earlier), "earlier_attempts": "; ".join(earlier)}
        if row["status"] not in RETRIED or cancel.flag[0]:
            break
        earlier.append(f"{settings.text()}: {row['status']} ({row['message']})")
    return row


def crashed_row(
    plan: Plan,
    sample: int,
    values: Mapping[str, float],
    message: str,
    *,
    status: str = "crashed",
    wall_s: float | None = None,
    attempts: int = 1,
) -> Row:
    """Return the row of a run that ended without a certificate."""
    nothing = dict.fromkeys((*plan.mechanism.responses, "steps", "max_residual", "max_penetration"))
    tail = {"status": status, "message": message, "wall_s": wall_s, "settled": False}
    return {"sample": sample, **values, **nothing, **tail, "attempts": attempts, "earlier_attempts": ""}


def rows_to_table(plan: Plan, rows: list[Row]) -> pa.Table:
    """Return rows as a table of the plan's schema."""
    columns = zip(plan.schema.names, plan.schema.types, strict=True)
    return pa.table([pa.array([row[name] for row in rows], kind) for name, kind in columns], schema=plan.schema)


def inputs(plan: Plan, samples: Sequence[int]) -> Iterator[tuple[int, dict[str, float]]]:
    """Yield samples and their inputs by variable name; all between the first and the last are drawn at once."""
    first = min(samples)
    drawn = draw(plan.spec, first, max(samples) + 1 - first)
    for sample in samples:
        yield sample, {name: float(x[sample - first]) for name, x in drawn.items()}


def sample_values(plan: Plan, sample: int) -> dict[str, float]:
    """Return the inputs of one sample by variable name."""
    return dict(next(inputs(plan, [sample]))[1])


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


def _attempt(
    plan: Plan, simulate: Simulate, sample: int, values: Mapping[str, float], settings: Simulation, cancel: "Cancel"
) -> Row:
    """Simulate one sample with given settings; whatever happens in the run, the answer is a row."""
    start = perf_counter()
    inputs_by_key = {plan.targets[name]: x for name, x in values.items()}
    changes = {**settings.values(), **plan.spec.execution.values(), **inputs_by_key}
    try:
        with time_limit(_longest(plan)):
            run = simulate(plan.mechanism, changes, step=settings.step, horizon=settings.horizon, cancel=cancel)
    except MemoryError:
        limit = plan.spec.execution.memory_limit
        message = f"out of memory: the process may use {limit:g} GiB (execution.memory_limit)"
        return crashed_row(plan, sample, values, message, wall_s=perf_counter() - start)
    except Exception as error:  # a run never stops the others
        return crashed_row(plan, sample, values, f"{type(error).__name__}: {error}", wall_s=perf_counter() - start)
    status, message = _checked(run, plan.mechanism)
    return {
        "sample": sample,
        **values,
        **(run.responses if status == "ok" else dict.fromkeys(plan.mechanism.responses)),
        "status": status,
        "message": message,
        "steps": run.certificate.steps,
        "wall_s": run.certificate.wall_s,
        "max_residual": run.certificate.max_residual,
        "max_penetration": run.certificate.max_penetration,
        "settled": run.certificate.settled,
    }


def _longest(plan: Plan) -> float:
    """Return the real time [s] of a run that takes no notice of its own limit: twice that limit and a second."""
    limit = plan.spec.execution.time_limit
    return 2.0 * (plan.mechanism.simulation.wall_limit if limit is None else limit) + 1.0


def _checked(run: Run, mechanism: Mechanism) -> tuple[str, str]:
    """Return status and message of a run; an ``ok`` one must have every response, finite."""
    if run.status == "ok":
        responses: Mapping[str, float] = run.responses
        unusable = [name for name in mechanism.responses if not isfinite(responses.get(name, nan))]
        if unusable:
            return "invalid", f"no finite value of {', '.join(unusable)}"
    return run.status, run.message
