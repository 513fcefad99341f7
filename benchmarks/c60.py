"""Consecutive settled runs of the C-60 in this process: the time loop, and the other costs of a run."""

from collections.abc import Callable
from statistics import median
from time import process_time
from typing import Any, TypeVar

from campaign.plan import Plan, make_plan
from campaign.spec.load import load_campaign
from campaign.worker.row import compute_row, sample_values
from engine import Certificate, load_mechanism, simulate
from engine.assembly import assemble
from engine.equilibrium import PoseAtRest
from engine.execution import contacts_with_ranges
from engine.kernels.time_loop import PHASE, STEP, TIME
from engine.loop import Cancel, control_of, drive
from engine.mechanism import Mechanism, set_values

SAMPLES = 12
MANY = 100  # samples whose parts are measured
Result = TypeVar("Result")


def measure(unit_us: float) -> dict[str, Any]:
    """Return medians over the first samples of the shipped campaign; ``unit_us`` is the reference [us]."""
    mechanism, plan = load_mechanism("c60"), make_plan(load_campaign("c60"))
    runs = [_quicker(mechanism, sample_values(plan, sample)) for sample in range(SAMPLES)]
    settled = [certificate for certificate in runs if certificate.settled]
    step_us = median(1e6 * c.wall_s / c.steps for c in settled)
    return {
        "runs": len(runs),
        "settled": len(settled),
        "run_s": median(c.wall_s for c in settled),
        "slowest_run_s": max(c.wall_s for c in settled),
        "steps": median(c.steps for c in settled),
        "step_us": step_us,
        "step_in_solves": step_us / unit_us,
        "iterations_per_step": median(c.iterations / c.steps for c in settled),
    }


def measure_parts(unit_us: float) -> list[dict[str, Any]]:
    """Return the processor time of each part of a run and of its row [us], medians over the first 100 samples."""
    plan = make_plan(load_campaign("c60"))
    runs = [_parts(plan, sample) for sample in range(MANY)]
    parts = {part: median(run[part] for run in runs) for part in runs[0]}
    return [{"part": part, "us": us, "in_solves": us / unit_us} for part, us in parts.items()]


def _quicker(mechanism: Any, values: dict[str, float]) -> Certificate:
    """Return the certificate of the faster of two runs."""
    return min((simulate(mechanism, values).certificate for _ in range(2)), key=lambda c: c.wall_s)


def _parts(plan: Plan, sample: int) -> dict[str, float]:
    """Return the time of each part of a run [us], measured in one run, and the time of its row, in another run."""
    values, took = sample_values(plan, sample), {}

    def timed(part: str, call: Callable[..., Result], *given: Any) -> Result:
        start = process_time()
        result = call(*given)
        took[part] = 1e6 * (process_time() - start)
        return result

    changes = {plan.targets[name]: value for name, value in values.items()}
    mechanism: Mechanism = timed("values set", set_values, plan.mechanism, changes)
    assembly = timed("assembly", assemble, mechanism)
    control = control_of(mechanism, False)
    course = timed("time loop", drive, assembly, control, mechanism.simulation.wall_limit)
    end = int(course.counts[PHASE]), float(course.reals[TIME]), float(course.reals[STEP])
    pose = timed("forces at rest", PoseAtRest, mechanism, assembly, *end)
    timed("ranges of forces", pose.ranges, list(contacts_with_ranges(mechanism, end[0]).values()))
    parts = sum(took.values())
    timed("row", compute_row, plan, simulate, sample, values, 1, Cancel())
    return {**took, "row less its parts": took["row"] - parts, "row less the loop": took["row"] - took["time loop"]}
