"""A sample becomes a row: its inputs, its run or runs, what they said, and how they ended. Whatever happens, a row."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from math import isfinite, nan
from time import perf_counter
from typing import TYPE_CHECKING, Any

import pyarrow as pa

from campaign.inputs.sampling import draw
from campaign.plan import Plan
from campaign.spec.policy import RETRIED, Simulation
from campaign.worker.limits import time_limit
from engine import Run
from engine.mechanism import Mechanism

if TYPE_CHECKING:
    from engine.loop import Cancel

Simulate = Callable[..., Run]
Row = dict[str, Any]


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
