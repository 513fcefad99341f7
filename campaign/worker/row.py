"""Turn a sample into a row of the table: its inputs, its responses, and how its run ended. Every run becomes a row."""

from collections.abc import Iterator, Mapping, Sequence
from math import isfinite, nan
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from campaign.inputs.sampling import draw, sampler_named
from campaign.plan import Plan
from campaign.repeat_plan import SETTINGS, RepeatPlan
from campaign.spec.campaign_file import RETRIED, SimulationSettings
from campaign.spec.result_columns import ENERGY_COLUMNS
from campaign.worker.halved_step import what_differs
from campaign.worker.limits import time_limit
from campaign.worker.messages import Simulate
from engine import Run
from engine.mechanism import Mechanism

if TYPE_CHECKING:
    from engine.loop import Cancel

Row = dict[str, Any]

# Errors that show that the machine lacks something: memory, a disk, a file that existed a moment ago.
OF_THE_MACHINE = (MemoryError, OSError, ImportError)


class DoubtfulRow(Row):
    """The row of a run that raised an error that the machine may have caused; the run is repeated elsewhere."""


def compute_row(
    plan: Plan, simulate: Simulate, sample: int, values: Mapping[str, float], attempt: int, cancel: "Cancel"
) -> Row:
    """Simulate one sample, again with each setting of the retry policy until a run succeeds, and return its row.

    ``values`` are its inputs by variable name, ``attempt`` is the number of the first run, from 1. The row is that of
    the last run; it counts the attempts and says how the earlier ones ended.
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
    """Return the row of a run without a certificate, because it raised an error or ended its process.

    ``values`` are its inputs by variable name, ``status`` is ``crashed`` or ``timeout``, ``wall_s`` how long the run
    took [s], if known.
    """
    empty = dict.fromkeys((*plan.mechanism.responses, "steps", "max_residual", "max_penetration", *ENERGY_COLUMNS))
    ending = {"status": status, "message": message, "wall_s": wall_s, "settled": False}
    return {"sample": sample, **values, **empty, **ending, "attempts": attempts, "earlier_attempts": ""}


def rows_to_table(plan: Plan, rows: list[Row], schema: pa.Schema | None = None) -> pa.Table:
    """Return rows as a table with the plan's schema, or another one, including the columns that the sampler adds."""
    schema = plan.schema if schema is None else schema
    sample = np.array([row["sample"] for row in rows], np.int64)
    added = sampler_named(plan.spec.sampler).own_columns(plan.spec, sample)
    columns = zip(schema.names, schema.types, strict=True)
    values = [pa.array(added[name] if name in added else [r[name] for r in rows], kind) for name, kind in columns]
    return pa.table(values, schema=schema)


def repeats_to_table(plan: Plan, repeats: RepeatPlan, rows: list[Row]) -> pa.Table:
    """Return repeats as a table that also says in which settings they differ from the runs of their rows."""
    return rows_to_table(plan, [row | {SETTINGS: what_differs(plan, row)} for row in rows], repeats.schema)


def sample_inputs(plan: Plan, samples: Sequence[int]) -> Iterator[tuple[int, dict[str, float]]]:
    """Yield each sample and its inputs by variable name; all samples from smallest to largest are drawn at once."""
    first = min(samples)
    drawn = draw(plan.spec, first, max(samples) + 1 - first)
    for sample in samples:
        yield sample, {name: float(x[sample - first]) for name, x in drawn.items()}


def sample_values(plan: Plan, sample: int) -> dict[str, float]:
    """Return the inputs of one sample by variable name."""
    return dict(next(sample_inputs(plan, [sample]))[1])


def _attempt(
    plan: Plan,
    simulate: Simulate,
    sample: int,
    values: Mapping[str, float],
    settings: SimulationSettings,
    cancel: "Cancel",
) -> Row:
    """Simulate one sample once with the given settings; return a row, however the run ends."""
    start = perf_counter()
    inputs_by_key = {plan.targets[name]: x for name, x in values.items()}
    changes = {**settings.values(), **plan.spec.execution.values(), **inputs_by_key}
    try:
        with time_limit(_longest(plan)):
            run = simulate(plan.mechanism, changes, step=settings.step, horizon=settings.horizon, cancel=cancel)
        status, message = _checked(run, plan.mechanism)
    except (Exception, SystemExit) as error:  # one run never stops the others
        row = crashed_row(plan, sample, values, _text(error, plan), wall_s=perf_counter() - start)
        return DoubtfulRow(row) if isinstance(error, OF_THE_MACHINE) else row
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
        **{name: getattr(run.certificate, name) for name in ENERGY_COLUMNS},
        "settled": run.certificate.settled,
    }


def _text(error: BaseException, plan: Plan) -> str:
    """Return the message of a row about the error that its run raised."""
    if isinstance(error, MemoryError):
        limit = plan.spec.execution.memory_limit
        return f"out of memory: the process may use {limit:g} GiB (execution.memory_limit)"
    return f"{type(error).__name__}: {error}"


def longest_sample(plan: Plan) -> float:
    """Return the time that a sample may take, including all attempts that the retry policy allows [s]."""
    return (1 + len(plan.spec.failures.retry)) * _longest(plan)


def _longest(plan: Plan) -> float:
    """Return the time after which a run that ignores its time limit is killed: twice that limit plus a second [s]."""
    limit = plan.spec.execution.time_limit
    return 2.0 * (plan.mechanism.simulation.wall_limit if limit is None else limit) + 1.0


def _checked(run: Run, mechanism: Mechanism) -> tuple[str, str]:
    """Return status and message of a run; an ``ok`` run without a finite value of every response is ``invalid``."""
    if run.status == "ok":
        responses: Mapping[str, float] = run.responses
        unusable = [name for name in mechanism.responses if not isfinite(responses.get(name, nan))]
        if unusable:
            return "invalid", f"no finite value of {', '.join(unusable)}"
    return run.status, run.message
