"""One run of one mechanism: from a description and a set of values to responses and a certificate.

The compiled kernels are imported by the functions that need them: Numba alone takes longer to load than a description.
"""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from engine.mechanism import Mechanism, set_values

if TYPE_CHECKING:
    from engine.assembly import Array, Assembly
    from engine.loop import Cancel
    from engine.verdict import Status


@dataclass(frozen=True)
class Certificate:
    """What a run proves of itself.

    Attributes
    ----------
    steps : time steps made
    time : simulated time, in the mechanism's unit
    wall_s : real time [s]
    max_residual : largest relative residual of a friction problem (see `engine.friction`)
    max_penetration : largest gap violation left after a step, in the mechanism's unit of length
    max_violation : largest violation of an ideal joint or prescribed motion left after a step, in the same unit
    settled : at rest at the end
    iterations : Newton steps of the friction solver, all steps together
    repeated : steps that were repeated with half their length
    """

    steps: int
    time: float
    wall_s: float
    max_residual: float
    max_penetration: float
    max_violation: float
    settled: bool
    iterations: int
    repeated: int


@dataclass(frozen=True)
class Run:
    """Result of a run; ``responses`` is empty unless ``status`` is "ok"."""

    status: "Status"
    message: str
    responses: dict[str, float]
    units: dict[str, str]
    certificate: Certificate
    measured: dict[str, float] = field(default_factory=dict)
    """The responses as measured at the end of the run, also of a run that failed."""
    ranges: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Of each contact force read at rest, the least and the largest that friction allows at that pose."""


def simulate(
    mechanism: Mechanism,
    values: Mapping[str, float] | None = None,
    *,
    step: float | None = None,
    horizon: float | None = None,
    full_horizon: bool = False,
    cancel: "Cancel | None" = None,
    trajectory: str | Path | None = None,
    every: int = 1,
    indeterminacy: bool = False,
) -> Run:
    """Simulate a mechanism until it is at rest and measure its responses (paper, sections 2 and 4.1).

    Parameters
    ----------
    mechanism : the description, see `load_mechanism`
    values : what to change in it, e.g. ``{"J1": 0.05, "springs.A3.preload": 0.9}``
    step : one fixed step, in the place of the description's steps [its unit of time]
    horizon : override the description's ``[simulation]`` [its unit of time]
    full_horizon : do not stop at rest in the last phase
    cancel : a flag that ends the run when another thread sets it
    trajectory : an HDF5 file to write the whole motion to, whatever the run comes to; see `read_trajectory`
    every : write every so many-th step of it, and the last
    indeterminacy : also compute how far friction leaves the contact forces at rest open (`Run.ranges`)

    Raises
    ------
    MechanismError
        If a value is not allowed, or parts overlap at the start pose.
    TrajectoryError
        If the trajectory cannot be written.
    """
    from engine.assembly import assemble

    settings = {"simulation.step": step, "simulation.horizon": horizon}
    changes = {**(values or {}), **{key: value for key, value in settings.items() if value is not None}}
    mechanism = set_values(mechanism, changes) if changes else mechanism
    if step is not None:
        fixed = mechanism.simulation.model_copy(update={"adaptive": None})
        mechanism = mechanism.model_copy(update={"simulation": fixed})
    assembly = assemble(mechanism)
    if trajectory is None:
        return _execute(mechanism, assembly, full_horizon, cancel, indeterminacy)
    from engine.trajectory.write import recording

    with recording(trajectory, mechanism, assembly, every=every, full_horizon=full_horizon) as file:
        run = _execute(mechanism, assembly, full_horizon, cancel, indeterminacy, file.append, every)
        file.finish(run)
    return run


def check(mechanism: Mechanism, values: Mapping[str, float] | None = None) -> None:
    """Raise `MechanismError` if the mechanism with these values could not start: bad values, overlapping parts."""
    from engine.assembly import assemble

    assemble(set_values(mechanism, values) if values else mechanism)


def warm_up() -> float:
    """Compile the engine, or load it from the cache; return how long that took [s]."""
    from engine.mechanism import load_mechanism

    start = time.perf_counter()
    simulate(load_mechanism("incline"), horizon=1e-2)
    return time.perf_counter() - start


def _execute(
    mechanism: Mechanism,
    assembly: "Assembly",
    full_horizon: bool,
    cancel: "Cancel | None",
    indeterminacy: bool = False,
    sink: "Callable[[Array], None] | None" = None,
    every: int = 1,
) -> Run:
    """Run the time loop and translate its outcome."""
    from engine.derived import bounded_contacts, read_contacts, with_derived
    from engine.kernels import run
    from engine.loop import control_of, drive, prepare
    from engine.verdict import failure, judge

    control = control_of(mechanism, full_horizon)
    prepare(assembly, control)
    start = time.perf_counter()
    course = drive(assembly, control, mechanism.simulation.wall_limit, cancel, sink, every)
    counts, reals = course.counts, course.reals
    certificate = Certificate(
        steps=int(counts[run.STEPS]),
        time=float(reals[run.TIME]),
        wall_s=time.perf_counter() - start,
        max_residual=float(reals[run.RESIDUAL]),
        max_penetration=float(reals[run.WORST]),
        max_violation=float(reals[run.OFF]),
        settled=bool(counts[run.SETTLED]),
        iterations=int(counts[run.ITERATIONS]),
        repeated=int(counts[run.REPEATED]),
    )
    ranges: dict[str, tuple[float, float]] = {}  # of contacts
    read = read_contacts(mechanism)
    if counts[run.STATUS] == run.OK and certificate.settled:
        forces = _measure_at_rest(mechanism, assembly, int(counts[run.PHASE]), certificate.time)
        asked = [*bounded_contacts(mechanism), *(read.values() if indeterminacy else ())]
        if forces is not None and asked:
            ranges = _force_ranges(assembly, forces, list(dict.fromkeys(asked)))
    measured = dict(zip(mechanism.responses, map(float, assembly.work.reported), strict=True))
    measured = with_derived(mechanism, measured, ranges)
    if counts[run.STATUS] == run.OK:
        completed = bool(counts[run.COMPLETED]) or full_horizon
        status, message = judge(mechanism, measured, completed, int(counts[run.PHASE]))
    else:
        status, message = failure(mechanism, assembly, course)
    responses = measured if status == "ok" else {}
    left_open = {name: ranges[contact] for name, contact in read.items() if contact in ranges}
    return Run(status, message, responses, mechanism.response_units(), certificate, measured, left_open)


def _measure_at_rest(mechanism: Mechanism, assembly: "Assembly", phase: int, t: float) -> "Array | None":
    """Measure the contact forces of the end once more, as the pose at rest determines them.

    They are NaN where no forces in the friction cones balance the loads. Returns the forces, shape (nc, 3).
    """
    from engine.equilibrium import forces_at_rest
    from engine.kernels.model import CONTACT_FORCE, END
    from engine.kernels.responses import measure

    model, state, work = assembly.model, assembly.state, assembly.work
    if not (model.responses.kind >= CONTACT_FORCE).any():
        return None
    sim = mechanism.simulation
    touching_gap = max(sim.penetration, sim.rest.drift)  # a gap that is no larger than what counts as unmoved is closed
    forces = forces_at_rest(assembly, phase, sim.step, touching_gap, t)
    state.r[:] = math.nan if forces is None else forces
    measure(
        model.responses, model.contacts, model.loads, state, work.point, work.frame, t, 1.0, work.values, work.a, work.b
    )
    responses, last = model.responses, len(mechanism.phases) - 1
    # a speed stays what it was, and so does what was read at the end of an earlier phase
    forces_at_end = (responses.at == END) & (responses.kind >= CONTACT_FORCE) & (responses.to_phase == last)
    work.reported[forces_at_end] = work.values[forces_at_end]
    return forces


def _force_ranges(assembly: "Assembly", forces: "Array", contacts: list[str]) -> dict[str, tuple[float, float]]:
    """Return what friction leaves open of the normal forces of some contacts at rest."""
    from engine.equilibrium import normal_force_ranges

    numbers = [assembly.contact_names.index(contact) for contact in contacts]
    return dict(zip(contacts, normal_force_ranges(assembly, forces, numbers), strict=True))
