"""The time of a step, and the shares of its stages: the numbers shown by `clearcap bench`."""

import dataclasses
import time
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from engine import Mechanism

STEPS = 7000  # largest number of steps, unless a number is given
PAPER = {"c60": 1e-3}  # fixed steps [ms]: 7000 of them make up the paper's run
REPEATS = 2  # runs without clocks; the fastest counts
WALL_LIMIT = 600.0


@dataclasses.dataclass(frozen=True)
class StepTimes:
    """One mechanism, simulated with a fixed step to the end of its horizon, at rest or not."""

    mechanism: str
    status: str  # why the steps ended, as in a run; "ok" if all of them were made
    message: str
    step: float  # length, in the mechanism's unit of time
    bodies: int  # moving ones
    contacts: int  # potential ones
    ties: int  # bilateral rows: ideal joints and prescribed motions
    steps: int
    repeated: int  # of the steps, those that were repeated with half their length
    step_us: float  # real time per step, including responses [microseconds]
    iterations_per_step: float  # Newton and interior-point steps of the friction solver per time step
    # of the time, by stage of `engine.profile.timed_loop.STAGES`; "other" completes the sum to 1
    shares: dict[str, float]
    max_residual: float  # these three as in the certificate of a run
    max_penetration: float
    max_violation: float


def measure_step_times(mechanism: "Mechanism", steps: int | None = None) -> StepTimes:
    """Simulate a mechanism and measure the time of its steps.

    The time of a step is measured with the kernels that every run uses. The shares come from a second simulation with
    the same functions, compiled again with clocks between them (`engine.profile.timed_loop`). Compilation is not
    included.

    The mechanism's shortest step is used; for the C-60, the paper's. `steps` None means as many as fit into its
    horizon, at most ``STEPS``. Raises MechanismError if parts overlap at the start pose.
    """
    from engine.assembly import assemble
    from engine.kernels import time_loop
    from engine.loop import control_of, drive, prepare
    from engine.verdict import failure

    h = PAPER.get(mechanism.name, mechanism.simulation.step)
    count = steps or min(round(mechanism.simulation.horizon / h), STEPS)
    control = control_of(mechanism, True)._replace(step=h, longest=h, horizon=count * h)
    prepare(assemble(mechanism), control)  # compiles, which is not to be measured
    seconds = []
    for _ in range(REPEATS):
        assembly = assemble(mechanism)
        start = time.perf_counter()
        course = drive(assembly, control, WALL_LIMIT)
        seconds.append(time.perf_counter() - start)
    counts, reals = course.counts, course.reals
    good = counts[time_loop.STATUS] == time_loop.OK
    made = int(counts[time_loop.STEPS])
    return StepTimes(
        mechanism.name,
        *(("ok", "") if good else failure(mechanism, assembly, course)),
        step=h,
        bodies=len(assembly.model.bodies.mass),
        contacts=len(assembly.contact_names),
        ties=len(assembly.row_names),
        steps=made,
        repeated=int(counts[time_loop.REPEATED]),
        step_us=1e6 * min(seconds) / max(made, 1),
        iterations_per_step=float(counts[time_loop.ITERATIONS]) / max(made, 1),
        shares=shares(mechanism, control),
        max_residual=float(reals[time_loop.MAX_RESIDUAL]),
        max_penetration=float(reals[time_loop.MAX_PENETRATION]),
        max_violation=float(reals[time_loop.MAX_VIOLATION]),
    )


def shares(mechanism: "Mechanism", control: Any) -> dict[str, float]:
    """Return the share of the time that each stage of the steps takes; the sum is 1."""
    from engine.assembly import assemble
    from engine.kernels.time_loop import new_course
    from engine.profile.timed_loop import STAGES, timed_loop

    run_timed, spent = timed_loop()
    total = 0.0
    for settings in (control._replace(horizon=0.0), control):  # the first compiles
        assembly = assemble(mechanism)
        rows, stop = np.zeros((1, 1)), np.zeros(1, np.uint8)
        spent[:] = 0
        start = time.perf_counter()
        run_timed(assembly.arrays, settings, new_course(settings), rows, 0, stop)
        total = time.perf_counter() - start
    parts = {stage: 1e-9 * int(ns) / total for stage, ns in zip(STAGES, spent, strict=True)}
    return {**parts, "other": 1 - sum(parts.values())}
