"""What a worker does: compute one batch and write its part. Only counts travel back."""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from math import isfinite
from time import perf_counter
from typing import Any, TypedDict

import pyarrow as pa

from campaign.errors import CampaignError
from campaign.plan import Plan
from campaign.sampling import draw
from campaign.store import BadPart, Store, open_store
from engine import build_id, simulate
from engine.mechanism import Mechanism
from engine.simulate import Run

Simulate = Callable[..., Run]
Row = dict[str, Any]


class Done(TypedDict):
    """What a task reports."""

    batch: int
    statuses: dict[str, int]


@dataclass(frozen=True)
class Task:
    """A batch, addressed: small enough to travel, complete enough to be computed anywhere.

    Attributes
    ----------
    store : str
        URL of the store.
    campaign_id : str
        Whose plan to follow.
    engine_build : str
        The build of the engine that the plan is for.
    simulate : callable
        `engine.simulate`, or what a test puts in its place.
    """

    store: str
    campaign_id: str
    engine_build: str
    simulate: Simulate = simulate


def run_batch(task: Task, batch: int) -> Done:
    """Compute a batch and write its part, unless it is there.

    Returns
    -------
    Done
        How many rows ended in which status.

    Raises
    ------
    CampaignError
        If this process runs another engine build than the plan is for.
    StoreError
        If the store fails.
    """
    store, plan = _opened(task)
    try:
        table = store.read_part(plan, batch)
    except (FileNotFoundError, BadPart):
        first, count = plan.batches[batch]
        table = rows_to_table(plan, [_row(plan, task.simulate, sample) for sample in range(first, first + count)])
        store.write_part(plan, batch, table)
    return {"batch": batch, "statuses": dict(Counter(table["status"].to_pylist()))}


def run_sample(task: Task, sample: int, attempts: int) -> Row:
    """Compute the row of one sample, for the case that its batch kills its process."""
    _, plan = _opened(task)
    return _row(plan, task.simulate, sample, attempts)


def crashed_row(plan: Plan, sample: int, message: str, attempts: int, wall_s: float | None = None) -> Row:
    """Return the row of a run that ended without a certificate."""
    nothing = dict.fromkeys((*plan.mechanism.responses, "steps", "max_residual", "max_penetration"))
    head = {"sample": sample, **sample_values(plan, sample)}
    tail = {"status": "crashed", "message": message, "wall_s": wall_s, "settled": False, "attempts": attempts}
    return {**head, **nothing, **tail}


def rows_to_table(plan: Plan, rows: list[Row]) -> pa.Table:
    """Return rows as a table of the plan's schema."""
    return pa.Table.from_pylist(rows, schema=plan.schema)


def sample_values(plan: Plan, sample: int) -> dict[str, float]:
    """Return the inputs of one sample by variable name."""
    drawn = draw(plan.spec.variables, plan.spec.seed, sample, 1, plan.spec.sampler)
    return {name: float(x[0]) for name, x in drawn.items()}


@lru_cache(maxsize=4)
def _opened(task: Task) -> tuple[Store, Plan]:
    if build_id() != task.engine_build:
        raise CampaignError(
            f"campaign {task.campaign_id} is planned for engine build {task.engine_build}, this process runs"
            f" {build_id()}; install that version here, or run the campaign anew"
        )
    store = open_store(task.store)
    return store, store.plan(task.campaign_id)


def _row(plan: Plan, simulate: Simulate, sample: int, attempts: int = 1) -> Row:
    """Simulate one sample; whatever happens in the run, the answer is a row."""
    values, settings, start = sample_values(plan, sample), plan.spec.simulation, perf_counter()
    targets = plan.spec.targets()
    try:
        run = simulate(
            plan.mechanism,
            {targets[name]: value for name, value in values.items()},
            step=settings.step,
            horizon=settings.horizon,
        )
    except Exception as error:  # a run never stops the others
        return crashed_row(plan, sample, f"{type(error).__name__}: {error}", attempts, perf_counter() - start)
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
        "attempts": attempts,
    }


def _checked(run: Run, mechanism: Mechanism) -> tuple[str, str]:
    """Return status and message of a run; an ``ok`` one must have every response, finite."""
    responses: Mapping[str, float] = run.responses
    unusable = [name for name in mechanism.responses if not isfinite(responses.get(name, float("nan")))]
    if run.status == "ok" and unusable:
        return "invalid", f"no finite value of {', '.join(unusable)}"
    return run.status, run.message
