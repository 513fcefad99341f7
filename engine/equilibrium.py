"""Contact forces at rest: of all that keep the balance, those of equally stiff contacts.

With everything sticking the forces are not unique: friction at redundant contacts may lock in any of a continuum.
The ones reported are the limit of contacts that are all equally, and hardly, compliant, u = -c r: the balanced
forces inside Coulomb's cones with the least sum of squares. They follow from the pose alone, not from its history.
"""

from typing import TYPE_CHECKING

import numpy as np

from engine.friction.arrays import CONVERGED, friction_arrays
from engine.friction.solver import solve_friction
from engine.friction.ties import hold_ties, tie_down
from engine.kernels.contacts import add_whitened, relative_velocity, whitened_rows
from engine.kernels.gaps import find_contacts
from engine.kernels.loads import apply_loads
from engine.kernels.motion import free_twist
from engine.kernels.ties import tie_velocity, tie_violations, whitened_ties

if TYPE_CHECKING:
    from engine.assembly import Array, Assembly
    from engine.friction.arrays import FrictionArrays
    from engine.kernels.model import Bodies

# compliance, as a share of the mean diagonal of the Delassus operator, and the residual to reach with it: the limit is
# good to 1e-3 N with the first; the others are for poses at the very edge of sliding, where the first is not solved
HELD = 1e-2  # of the free motion: more than the compliance gives way by, less than any sliding
ATTEMPTS = ((1e-6, 1e-9), (1e-7, 1e-9), (1e-6, 1e-7))
REFINEMENTS = 2  # each leaves of the unbalance a share of the order of the compliance times what amplifies it


def forces_at_rest(assembly: "Assembly", phase: int, h: float, touching_gap: float, t: float = 0.0) -> "Array | None":
    """Return the contact forces that hold the loads of ``phase`` and time ``t`` at the present pose.

    Parameters
    ----------
    assembly : the mechanism, at rest; its twists are set to zero
    phase : which forces and torques act
    h : any time; the forces are the impulses in it, by its length
    touching_gap : contacts open by no more than this touch
    t : time since the start of the run, for loads with a time law

    Returns
    -------
    array, shape (nc, 3)
        Forces (N, T1, T2); None if the contacts that touch cannot hold the loads.
    """
    model, state, work = assembly.model, assembly.state, assembly.work
    bodies, contacts, laws = model.bodies, model.contacts, model.laws
    h *= 1e-3  # so short that the free motion of an unloaded step has no gyroscopic part
    state.v[:] = 0
    apply_loads(bodies, model.loads, model.time_laws, state, phase, t, work.wrench, work.a, work.b)
    free_twist(bodies, state.R, state.v, work.wrench, h, 0.5, state.v, 1, work.free)
    find_contacts(contacts, state.x, state.R, work.gap, work.point, work.frame)

    touching = np.flatnonzero((state.r[:, 0] > 0) | (work.gap <= touching_gap))
    n, nc, falling = assembly.problem.w.size, touching.size, _energy_norm(bodies, work.free)
    # each contact's compliance is a spring of its own: three velocities that only this contact touches
    problem = friction_arrays(n + 3 * nc, nc, runs=3, k=15, band=n + 3 * nc, ties=model.ties.kind.size)
    _hold_joints(assembly, problem)
    for j, i in enumerate(touching):
        at = (contacts.a[i], contacts.b[i], work.point, work.frame)
        whitened_rows(bodies, state.x, state.R, *at, i, problem.rows, j)
        relative_velocity(state.x, state.R, *at, work.free, i, work.q)
    diagonal = np.sum(problem.rows.G[:nc] ** 2) / max(3 * nc, 1)
    widths = problem.rows.width.sum(axis=1)
    problem.mu[:] = laws.mu[touching]
    for compliance, tolerance in ATTEMPTS:
        problem.q[:] = work.q[touching]
        for j in range(nc):
            problem.rows.start[j, 2], problem.rows.width[j, 2] = n + 3 * j, 3
            problem.rows.G[j, :, widths[j] : widths[j] + 3] = np.sqrt(compliance * diagonal) * np.eye(3)
        problem.r[:] = 0
        status, _, _ = solve_friction(n + 3 * nc, nc, problem, tolerance)
        if status == CONVERGED:
            held = work.free.copy()
            add_whitened(bodies, problem.w, held)
            if _energy_norm(bodies, held) > HELD * falling:
                return None  # the bodies would move: friction cannot hold them
            impulses = problem.r.copy()
            # the springs gave way by a share of the load: again, from springs that already carry these impulses
            for _ in range(REFINEMENTS):
                problem.q[:] = work.q[touching] - compliance * diagonal * impulses
                if solve_friction(n + 3 * nc, nc, problem, tolerance)[0] != CONVERGED:
                    break
                impulses = problem.r.copy()
            forces = np.zeros_like(state.r)
            forces[touching] = impulses / h
            return forces
    return None


def _hold_joints(assembly: "Assembly", problem: "FrictionArrays") -> None:
    """Tie the problem's velocities by the ideal joints at the present pose, and hold the free motion by them."""
    bodies, ties, state, work = assembly.model.bodies, assembly.model.ties, assembly.state, assembly.work
    held, known, tied, n = work.held, assembly.problem.ties, problem.ties, problem.w.size
    tied.at[:], tied.start[:], tied.width[:] = known.at, known.start, known.width
    tie_violations(ties, state.x, state.R, held.target[1], held.violation, held.point, held.way)
    whitened_ties(bodies, ties, state.x, state.R, held.point, held.way, tied.J)
    tie_down(n, tied)
    pose = (ties, state.x, state.R, held.point, held.way)
    rates = np.array([tie_velocity(*pose, work.free, i) for i in range(ties.kind.size)])
    hold_ties(n, tied, rates, problem.w)
    add_whitened(bodies, problem.w, work.free)


def _energy_norm(bodies: "Bodies", twist: "Array") -> float:
    """Return the square root of twice the kinetic energy."""
    v, spin = twist[:-1, :3], twist[:-1, 3:]
    turning = np.einsum("bi,bij,bj", spin, bodies.inertia, spin)
    return float(np.sqrt(np.sum(bodies.mass[:, None] * v**2) + turning))
