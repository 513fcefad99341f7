"""Execute one run of an assembled mechanism: the time loop, the forces at rest, the verdict."""

import math
import time
from collections.abc import Callable

from engine.arrays import Array
from engine.assembly import Assembly
from engine.derived import bounded_contacts, read_contacts, with_derived
from engine.equilibrium import forces_at_rest, normal_force_ranges
from engine.kernels import time_loop
from engine.kernels.model import CONTACT_FORCE, END
from engine.kernels.responses import measure
from engine.loop import Cancel, control_of, drive, prepare
from engine.mechanism import Mechanism
from engine.run import Certificate, Run
from engine.unrest import unheld, unrest
from engine.verdict import failure, judge, unfinished


def execute(
    mechanism: Mechanism,
    assembly: Assembly,
    full_horizon: bool,
    cancel: Cancel | None,
    indeterminacy: bool = False,
    sink: Callable[[Array], None] | None = None,
    every: int = 1,
) -> Run:
    """Run the time loop and judge its outcome.

    Parameters
    ----------
    mechanism : Mechanism
    assembly : Assembly
        The mechanism's, at its start.
    full_horizon : bool
        Do not stop at rest in the last phase.
    cancel : Cancel or None
        A flag that ends the run from another thread.
    indeterminacy : bool
        Also compute the ranges of the contact forces at rest.
    sink, every
        See `engine.loop.drive`.

    Returns
    -------
    Run
    """
    control = control_of(mechanism, full_horizon)
    prepare(assembly, control)
    start = time.perf_counter()
    course = drive(assembly, control, mechanism.simulation.wall_limit, cancel, sink, every)
    counts, reals = course.counts, course.reals
    certificate = Certificate(
        steps=int(counts[time_loop.STEPS]),
        time=float(reals[time_loop.TIME]),
        wall_s=time.perf_counter() - start,
        max_residual=float(reals[time_loop.MAX_RESIDUAL]),
        max_penetration=float(reals[time_loop.MAX_PENETRATION]),
        max_violation=float(reals[time_loop.MAX_VIOLATION]),
        settled=bool(counts[time_loop.SETTLED]),
        iterations=int(counts[time_loop.ITERATIONS]),
        repeated=int(counts[time_loop.REPEATED]),
    )
    ranges: dict[str, tuple[float, float]] = {}  # of contacts
    drift = ""
    read_at_end = read_contacts(mechanism)
    if counts[time_loop.STATUS] == time_loop.OK and certificate.settled:
        forces = measure_at_rest(mechanism, assembly, int(counts[time_loop.PHASE]), certificate.time)
        contacts = [*bounded_contacts(mechanism), *(read_at_end.values() if indeterminacy else ())]
        if forces is None:
            drift = unheld(mechanism, assembly, control)
        elif contacts:
            ranges = ranges_at_rest(assembly, forces, list(dict.fromkeys(contacts)))
    measured = dict(zip(mechanism.responses, map(float, assembly.work.reported), strict=True))
    measured = with_derived(mechanism, measured, ranges)
    if counts[time_loop.STATUS] == time_loop.OK:
        if counts[time_loop.COMPLETED] or full_horizon:
            status, message = judge(mechanism, measured, certificate.settled, drift)
        else:
            left = mechanism.simulation.wall_limit - certificate.wall_s
            motion = "" if certificate.settled else unrest(mechanism, assembly, control, course, left, cancel)
            status, message = unfinished(mechanism, int(counts[time_loop.PHASE]), certificate.settled, motion)
    else:
        status, message = failure(mechanism, assembly, course)
    responses = measured if status == "ok" else {}
    open_ranges = {name: ranges[contact] for name, contact in read_at_end.items() if contact in ranges}
    return Run(status, message, responses, mechanism.response_units(), certificate, measured, open_ranges)


def measure_at_rest(mechanism: Mechanism, assembly: Assembly, phase: int, t: float) -> Array | None:
    """Measure the contact forces at the end once more, as the pose at rest determines them.

    They are NaN if no forces in the friction cones balance the loads. Return the forces, shape (nc, 3), or None.
    """
    model, state, work = assembly.model, assembly.state, assembly.work
    if not (model.responses.kind >= CONTACT_FORCE).any():
        return None
    sim = mechanism.simulation
    touching_gap = max(sim.penetration, sim.rest.drift)  # a gap no larger than the drift allowed at rest is closed
    forces = forces_at_rest(assembly, phase, sim.step, touching_gap, t)
    state.r[:] = math.nan if forces is None else forces
    measure(model.responses, model.contacts, model.loads, state, work.sites, work.values, work.vectors, (t, 1.0))
    responses, last = model.responses, len(mechanism.phases) - 1
    # speeds keep their values, and so do responses that were read at the end of an earlier phase
    forces_at_end = (responses.at == END) & (responses.kind >= CONTACT_FORCE) & (responses.to_phase == last)
    work.reported[forces_at_end] = work.values[forces_at_end]
    return forces


def ranges_at_rest(assembly: Assembly, forces: Array, contacts: list[str]) -> dict[str, tuple[float, float]]:
    """Return contact -> least and largest normal force that friction allows at rest."""
    numbers = [assembly.contact_names.index(contact) for contact in contacts]
    return dict(zip(contacts, normal_force_ranges(assembly, forces, numbers), strict=True))
