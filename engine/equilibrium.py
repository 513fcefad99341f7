"""Contact forces at rest: of all that keep the balance, those of equally stiff contacts.

With everything sticking the forces are not unique: friction at redundant contacts may lock in any of a continuum.
The ones reported are the limit of contacts that are all equally, and hardly, compliant, u = -c r: the balanced
forces inside Coulomb's cones with the least sum of squares. They follow from the pose alone, not from its history.
"""

from typing import TYPE_CHECKING

import numpy as np

from engine.friction.arrays import CONVERGED, friction_arrays
from engine.friction.solver import solve_friction
from engine.kernels.contacts import add_whitened, relative_velocity, whitened_rows
from engine.kernels.gaps import find_contacts
from engine.kernels.loads import apply_loads
from engine.kernels.motion import free_twist

if TYPE_CHECKING:
    from engine.assembly import Array, Assembly
    from engine.kernels.model import Bodies

# compliance, as a share of the mean diagonal of the Delassus operator, and the residual to reach with it: the limit is
# good to 1e-3 N with the first; the others are for poses at the very edge of sliding, where the first is not solved
HELD = 1e-2  # of the free motion: more than the compliance gives way by, less than any sliding
ATTEMPTS = ((1e-6, 1e-9), (1e-7, 1e-9), (1e-6, 1e-7))


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
    free_twist(bodies, state.R, state.v, work.wrench, h, 0.5, False, work.free)
    find_contacts(contacts, state.x, state.R, work.gap, work.point, work.frame)

    touching = np.flatnonzero((state.r[:, 0] > 0) | (work.gap <= touching_gap))
    n, nc = 6 * bodies.mass.size, touching.size
    # each contact's compliance is a spring of its own: three velocities that only this contact touches
    problem = friction_arrays(n + 3 * nc, nc, runs=3, k=15, band=n + 3 * nc)
    for j, i in enumerate(touching):
        at = (contacts.a[i], contacts.b[i], work.point, work.frame)
        whitened_rows(bodies, state.x, state.R, *at, i, problem.rows, j)
        relative_velocity(state.x, state.R, *at, work.free, i, work.q)
    diagonal = np.sum(problem.rows.G[:nc] ** 2) / max(3 * nc, 1)
    widths = problem.rows.width.sum(axis=1)
    problem.mu[:] = laws.mu[touching]
    falling = _energy_norm(bodies, work.free)
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
            # the springs gave way by a share of the load: once more, from springs that already carry these impulses
            problem.q[:] -= compliance * diagonal * impulses
            if solve_friction(n + 3 * nc, nc, problem, tolerance)[0] == CONVERGED:
                impulses = problem.r
            forces = np.zeros_like(state.r)
            forces[touching] = impulses / h
            return forces
    return None


def _energy_norm(bodies: "Bodies", twist: "Array") -> float:
    """Return the square root of twice the kinetic energy."""
    v, spin = twist[:-1, :3], twist[:-1, 3:]
    turning = np.einsum("bi,bij,bj", spin, bodies.inertia, spin)
    return float(np.sqrt(np.sum(bodies.mass[:, None] * v**2) + turning))
