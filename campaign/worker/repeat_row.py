"""A sample computed again, and compared with its row in the store, bit for bit."""

import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from campaign.compiling import load_engine
from campaign.plan import Plan
from campaign.plan_header import PlanHeader
from campaign.spec.result_columns import ENERGY_COLUMNS
from campaign.store import BadPart, Store
from campaign.store.repeat_sets import repeat_plans
from campaign.worker.halved_step import HalvedStep
from campaign.worker.row import compute_row, sample_values
from engine import simulate
from engine.loop import Cancel


@dataclass(frozen=True)
class RepeatedSample:
    """A sample computed again."""

    row: dict[str, Any]  # computed now
    stored: dict[str, Any] | None  # None if the store has no row of this sample
    same: bool | None  # in everything that the sample determines; None if the store has no row


def repeated_sample(
    store: Store, plan: Plan, sample: int, motion: Path | None = None, *, halved: bool = False
) -> RepeatedSample:
    """Compute a sample as a worker would, or its repeat with half the step, and compare it with the store.

    ``motion`` is an HDF5 file to write its motion to. Raises MechanismError and TrajectoryError as `engine.simulate`
    does.
    """
    load_engine()
    run = partial(simulate, trajectory=motion) if motion else simulate
    row = compute_row(plan, HalvedStep(run) if halved else run, sample, sample_values(plan, sample), 1, Cancel())
    tables = repeat_plans(store, plan) if halved else (plan,)
    stored = next((found for table in tables if (found := stored_row(store, table, sample))), None)
    same = None if stored is None else _same(row, stored, list(plan.mechanism.responses))
    return RepeatedSample(row, stored, same)


def stored_row(store: Store, table: PlanHeader, sample: int) -> dict[str, Any] | None:
    """Return the stored row of a sample, from a campaign or a set of its repeats; None if there is none.

    Raises StoreError if the store cannot be read.
    """
    at = table.rows_before(sample)
    if table.numbers_of(at, at + 1) != [sample]:
        return None
    batch = next(b for b, (first, count) in enumerate(table.batches) if first <= at < first + count)
    try:
        rows = store.read_part(table, batch)
    except (FileNotFoundError, BadPart):
        return None
    row: dict[str, Any] = rows.slice(at - table.batches[batch][0], 1).to_pylist()[0]
    return row


def _same(row: dict[str, Any], stored: dict[str, Any], responses: list[str]) -> bool:
    """Return whether two rows agree in everything that the sample determines."""
    names = ["status", "message", "steps", "max_residual", "max_penetration", "settled", *responses]
    names += [name for name in ENERGY_COLUMNS if name in stored]
    return all(_equal(row[name], stored[name]) for name in names)


def _equal(a: Any, b: Any) -> bool:
    """Return whether two values are equal; NaN equals NaN."""
    both_nan = isinstance(a, float) and isinstance(b, float) and math.isnan(a) and math.isnan(b)
    return bool(a == b or both_nan)
