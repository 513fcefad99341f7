"""Turn samples into rows of the table: inputs, responses, and how each run ended. Every run becomes a row.

Repeats, which are runs with half the step, become rows too. A row can be computed again and compared with the one in
the store.
"""

import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import lru_cache, partial
from math import isfinite, nan
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from campaign.compiling import load_engine
from campaign.inputs.sampling import draw, sampler_named
from campaign.plan import Plan
from campaign.plan_header import SETTINGS, PlanHeader, RepeatPlan, plan_repeats
from campaign.processes import meanwhile
from campaign.spec.campaign_file import RETRIED, SimulationSettings
from campaign.spec.result_columns import LATER_COLUMNS, LATER_NUMBERS
from campaign.store import BadPart, Store, open_store
from campaign.store.layout import CANCEL
from campaign.store.store import repeat_plans
from campaign.worker.messages import CampaignAddress, Cancelled, DoubtfulRun, Simulate, check_build
from engine import NotAssemblable, Run, simulate
from engine.mechanism import Mechanism, get_value, unit_of
from engine.platform.child import Limits, limited

if TYPE_CHECKING:
    from engine.loop import Cancel


Row = dict[str, Any]

# Errors that show that the machine lacks something: memory, a disk, a file that existed a moment ago.
OF_THE_MACHINE = (MemoryError, OSError, ImportError)

STEP = "simulation.step"  # the fixed step, or the shortest of adaptive ones
OF_ADAPTIVE = ("simulation.adaptive.longest", "simulation.adaptive.travel")
WALL_LIMIT = "simulation.wall_limit"
GIB = 1 << 30
CHECK_INTERVAL = 2.0  # s between two checks whether the campaign is cancelled


class DoubtfulRow(Row):
    """The row of a run that raised an error that the machine may have caused; the run is repeated elsewhere."""


def compute_row(
    plan: Plan, simulate: Simulate, sample: int, values: Mapping[str, float], attempt: int, cancel: "Cancel"
) -> Row:
    """Simulate one sample, again with each setting of the retry policy until a run succeeds; return its last row."""
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
) -> Row:
    """Return the row of a run without a certificate, because it raised an error or ended its process."""
    empty = dict.fromkeys((*plan.mechanism.responses, "steps", "max_residual", "max_penetration", *LATER_COLUMNS))
    ending = {"status": status, "message": message, "wall_s": wall_s, "settled": False}
    return {"sample": sample, **values, **empty, **ending, "attempts": 1, "earlier_attempts": ""}


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

    def what_differs(row: Row) -> str:
        values = {target: row[name] for name, target in plan.targets.items()}
        halved = halved_settings(plan.mechanism, values, plan.spec.simulation.step)
        return ", ".join(f"{key} = {value!r} {unit_of(plan.mechanism, key)}" for key, value in halved.items())

    return rows_to_table(plan, [row | {SETTINGS: what_differs(row)} for row in rows], repeats.schema)


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
    except NotAssemblable as error:
        spent = perf_counter() - start
        return crashed_row(plan, sample, values, error.reason, status="not_assemblable", wall_s=spent)
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
        **{name: getattr(run.certificate, name) for name in LATER_NUMBERS},
        "settled": run.certificate.settled,
        "at_impact": ",".join(run.at_impact),
        "ambiguous": run.ambiguous,
    }


def _text(error: BaseException, plan: Plan) -> str:
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


# -- rows in this process ----------------------------------------------------------------------------------------------


@lru_cache(maxsize=4)
def open_campaign(address: CampaignAddress) -> tuple[Store, Plan]:
    """Return the store and the plan of a campaign after compiling the engine, for a process that computes rows."""
    check_build(address.campaign_id, address.row_build)
    if address.simulate is simulate:
        load_engine()
    return read_campaign(address)


@lru_cache(maxsize=4)
def read_campaign(address: CampaignAddress) -> tuple[Store, Plan]:
    """Return the store and the plan of a campaign, read once per process; WrongBuild if this one has another build."""
    check_build(address.campaign_id, address.row_build)
    store = open_store(address.store, address.retry_policy)
    return store, store.plan(address.campaign_id)


@lru_cache(maxsize=4)
def open_repeats(address: CampaignAddress) -> tuple[RepeatPlan, ...]:
    """Return the sets of repeats of a campaign; raises the same errors as `open_campaign`."""
    return plan_repeats(open_campaign(address)[1], address.repeats)


def rows_in_process(
    address: CampaignAddress, samples: Sequence[int], attempt: int = 1, begin: Callable[[int], None] = lambda _: None
) -> Iterator[Row]:
    """Yield the row of each sample, in order, computed here; ``begin`` is called with each before its run."""
    # Raises Cancelled, and DoubtfulRun if a run raises an error that the machine may have caused.
    from engine.loop import Cancel  # loads numba, which a coordinator that only requests batches does not need

    store, plan = open_campaign(address)
    run, cancel = HalvedStep(address.simulate) if address.halved else address.simulate, Cancel()
    marker, files = f"{plan.campaign_id}/{CANCEL}", store.files.hasty
    limits = Limits(memory=plan.spec.execution.memory_limit * GIB)
    with limited(limits), cancelled_by(lambda: files.exists(marker), cancel):
        for sample, values in sample_inputs(plan, samples):
            begin(sample)
            row = compute_row(plan, run, sample, values, attempt, cancel)
            if cancel.flag[0]:
                # not a row: the flag has cut the run short
                raise Cancelled(f"campaign {plan.campaign_id} is cancelled")
            if isinstance(row, DoubtfulRow):
                raise DoubtfulRun(row)
            yield row


# -- repeats -----------------------------------------------------------------------------------------------------------
#
# A run with half the step has the same physics of the same sample, stepped differently.
#
# If a mechanism sticks, slides and impacts, its position of rest depends on its history. With other step lengths the
# history differs by chance, so two runs of a sample show to what extent its inputs determine its result.


@dataclass(frozen=True)
class HalvedStep:
    """A replacement of ``simulate`` that halves the step, or all lengths of steps, and doubles the time limit."""

    simulate: Simulate

    def __call__(
        self, mechanism: Mechanism, values: Mapping[str, float], *, step: float | None = None, **how: Any
    ) -> Run:
        """Simulate a mechanism; the parameters are those of `engine.simulate`."""
        halved = halved_settings(mechanism, values, step)
        limit = {WALL_LIMIT: 2.0 * values.get(WALL_LIMIT, mechanism.simulation.wall_limit)}
        fixed = None if step is None else halved.pop(STEP)
        return self.simulate(mechanism, {**values, **limit, **halved}, step=fixed, **how)


def halved_settings(mechanism: Mechanism, values: Mapping[str, float], step: float | None) -> dict[str, float]:
    """Return, by key, half of each setting that determines the step lengths of a run: a fixed ``step``, or others."""
    if step is not None:
        return {STEP: 0.5 * step}
    keys = (STEP, *(OF_ADAPTIVE if mechanism.simulation.adaptive else ()))
    return {key: 0.5 * values.get(key, get_value(mechanism, key)) for key in keys}


# -- comparison with the store -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class RepeatedSample:
    """A sample computed again, and compared with its row in the store, bit for bit."""

    row: dict[str, Any]  # computed now
    stored: dict[str, Any] | None  # None if the store has no row of this sample
    same: bool | None  # in everything that the sample determines; None if the store has no row


def repeated_sample(
    store: Store, plan: Plan, sample: int, motion: Path | None = None, *, halved: bool = False
) -> RepeatedSample:
    """Compute a sample as a worker would, or its repeat, with its ``motion`` as HDF5, and compare it with the store."""
    from engine.loop import Cancel  # loads numba, which a coordinator that only requests batches does not need

    load_engine()
    run = partial(simulate, trajectory=motion) if motion else simulate
    row = compute_row(plan, HalvedStep(run) if halved else run, sample, sample_values(plan, sample), 1, Cancel())
    tables = repeat_plans(store, plan) if halved else (plan,)
    stored = next((found for table in tables if (found := stored_row(store, table, sample))), None)
    same = None if stored is None else _same(row, stored, list(plan.mechanism.responses))
    return RepeatedSample(row, stored, same)


def stored_row(store: Store, table: PlanHeader, sample: int) -> dict[str, Any] | None:
    """Return the stored row of a sample, from a campaign or a set of its repeats; None if there is none."""
    at = table.rows_before(sample)
    if table.numbers_of(at, at + 1) != [sample]:
        return None
    batch = table.batches_before(at + 1) - 1
    try:
        rows = store.read_part(table, batch)
    except (FileNotFoundError, BadPart):
        return None
    row: dict[str, Any] = rows.slice(at - table.batches[batch][0], 1).to_pylist()[0]
    return row


def _same(row: dict[str, Any], stored: dict[str, Any], responses: list[str]) -> bool:
    """Return whether two rows agree in everything that the sample determines."""
    names = ["status", "message", "steps", "max_residual", "max_penetration", "settled", *responses]
    names += [name for name in LATER_COLUMNS if name in stored]
    pairs = ((row[name], stored[name]) for name in names)
    return all(a == b or (a != a and b != b) for a, b in pairs)  # NaN equals NaN


# -- limits of a run: real time, and cancellation of its campaign ------------------------------------------------------


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Kill this process with SIGALRM if the block takes longer than ``seconds``."""
    # The engine ends a run at its own time limit. This limit is for code that ignores that one: the operating system's
    # timer needs neither the interpreter nor its lock.
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def cancelled_by(is_cancelled: Callable[[], bool], cancel: "Cancel") -> AbstractContextManager[None]:
    """Set ``cancel`` when ``is_cancelled`` returns True; a thread calls it every two seconds during the block."""

    def check(over: threading.Event) -> None:
        while not over.wait(CHECK_INTERVAL):
            try:
                if is_cancelled():
                    cancel.set()
                    return
            except Exception:  # the store cannot be reached: writing the batch will report it
                continue

    return meanwhile(check, "cancel")
