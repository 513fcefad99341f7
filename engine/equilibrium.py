"""Contact forces at rest: of all balanced forces, those of equally stiff contacts.

When all contacts stick, the forces are not unique: friction at redundant contacts may hold any of a continuum.
Those reported are the limit of contacts that are all equally, and hardly, compliant, u = -c r: the balanced
forces inside Coulomb's cones with the least sum of squares. They follow from the pose alone, not from its history.
Ideal joints and prescribed motions hold any load.
"""

import numpy as np

from engine.arrays import Array, Integers
from engine.assembly import Assembly
from engine.friction.arrays import CONVERGED, FrictionArrays, friction_arrays
from engine.friction.bilateral import factorise_bilateral, hold_bilateral
from engine.friction.indeterminacy import normal_force_range
from engine.friction.problem import dense_rows
from engine.friction.solver import solve_friction
from engine.kernels.bilateral import row_targets, row_velocity, row_violations, whitened_bilateral_rows
from engine.kernels.contact_geometry.gaps import find_contacts
from engine.kernels.contacts import add_whitened, relative_velocity, whitened_rows
from engine.kernels.loads import apply_loads
from engine.kernels.model import Bodies
from engine.kernels.motion import free_twist
from engine.kernels.rest import LOADED
from engine.linear_algebra import one_thread

HELD = 1e-2  # share of the free motion: more than the motion that the compliance allows, less than any sliding
# compliance, as a share of the mean diagonal of the Delassus operator, and the residual to reach with it: the first
# gives the limit to 1e-3 N; the others are for poses at the very edge of sliding, where the first is not solved
ATTEMPTS = ((1e-6, 1e-9), (1e-7, 1e-9), (1e-6, 1e-7))
REFINEMENTS = 2  # each reduces the unbalance to a share of the order of the compliance times its amplification


def forces_at_rest(assembly: Assembly, phase: int, h: float, touching_gap: float, t: float = 0.0) -> Array | None:
    """Return the contact forces that hold the loads of ``phase`` and time ``t`` at the present pose.

    Parameters
    ----------
    assembly : Assembly
        The mechanism, at rest; its twists are set to zero.
    phase : int
        Number of the phase whose forces and torques act.
    h : float
        Any time; the forces are the impulses in it, divided by its length.
    touching_gap : float
        Contacts open by no more than this length touch.
    t : float
        Time since the start of the run, for loads with a time law.

    Returns
    -------
    (nc, 3) array or None
        Forces (N, T1, T2). None if the contacts that touch cannot hold the loads: the twists of the bodies are then
        those with which they begin to move, of any size, or zero if the forces were not found.
    """
    model, state, work = assembly.model, assembly.state, assembly.work
    bodies, contacts = model.bodies, model.contacts
    h *= 1e-3  # so short that the free motion of an unloaded step has no gyroscopic part
    state.v[:] = 0
    apply_loads(bodies, model.loads, model.time_laws, state, phase, t, work.wrench, work.vectors)
    free_twist(bodies, state.R, state.v, work.wrench, h, 0.5, False, work.free)
    falling = _energy_norm(bodies, work.free)
    _hold(assembly, t)
    find_contacts(contacts, state.x, state.R, work.gap, work.sites.point, work.sites.frame)

    # a solver may leave 1e-27 of a zero impulse: a contact must be closed, or have carried a load
    pressed = state.r[:, 0] > LOADED * state.r[:, 0].max(initial=0.0)
    touching = np.flatnonzero(pressed | (work.gap <= touching_gap))
    problem = _problem(assembly, touching)
    n, nc = problem.w.size, touching.size
    diagonal = np.sum(problem.rows.G[:nc] ** 2) / max(3 * nc, 1)
    widths = problem.rows.width.sum(axis=1)
    for compliance, tolerance in ATTEMPTS:
        problem.q[:] = work.q[touching]
        for j in range(nc):
            problem.rows.start[j, 2], problem.rows.width[j, 2] = n - 3 * nc + 3 * j, 3
            problem.rows.G[j, :, widths[j] : widths[j] + 3] = np.sqrt(compliance * diagonal) * np.eye(3)
        problem.r[:] = 0
        status, _, _ = solve_friction(n, nc, problem, tolerance)
        if status == CONVERGED:
            held = work.free.copy()
            add_whitened(bodies, problem.w, held)
            if _energy_norm(bodies, held) > HELD * falling:
                state.v[:] = held  # the bodies would move: friction cannot hold them
                return None
            impulses = problem.r.copy()
            # the springs gave way by a share of the load: solve again, with springs that already carry these impulses
            for _ in range(REFINEMENTS):
                problem.q[:] = work.q[touching] - compliance * diagonal * impulses
                if solve_friction(n, nc, problem, tolerance)[0] != CONVERGED:
                    break
                impulses = problem.r.copy()
            forces = np.zeros_like(state.r)
            forces[touching] = impulses / h
            return forces
    return None


def normal_force_ranges(assembly: Assembly, forces: Array, wanted: list[int]) -> list[tuple[float, float]]:
    """Return the least and the largest normal force of some contacts among all forces with the same balance.

    Parameters
    ----------
    assembly : Assembly
        At rest, as `forces_at_rest` left it.
    forces : (nc, 3) array
        As `forces_at_rest` returned them.
    wanted : list of int
        Numbers of the contacts.

    Returns
    -------
    list of (least, largest)
        The largest is inf where friction wedges: see `engine.friction.indeterminacy`.
    """
    touching = np.flatnonzero(forces[:, 0] > 0)
    problem = _problem(assembly, touching)
    mu, r = problem.mu, forces[touching].ravel()
    place = {int(contact): j for j, contact in enumerate(touching)}
    with one_thread():
        H = _balance(assembly, problem, touching.size)
        return [normal_force_range(H, mu, r, place[i]) if i in place else (0.0, 0.0) for i in wanted]


def _balance(assembly: Assembly, problem: FrictionArrays, touching: int) -> Array:
    """Return the effect on the bodies of forces at the touching contacts: rows (N, T1, T2) each, less what joints hold.

    The shape is (3 touching, n), in the mass metric.
    """
    rows, system, n = problem.rows, problem.bilateral, problem.w.size
    H = dense_rows(rows.start, rows.width, rows.G, n).reshape(3 * touching, n)
    J = dense_rows(system.start, system.width, system.J[:, None], n)[:, 0]
    if len(J):  # what the joints hold does not belong to the balance
        H = H - (H @ np.linalg.pinv(J)) @ J
    return H


def _hold(assembly: Assembly, t: float) -> None:
    """Remove from the free twists the motion that ideal joints and prescribed motions prevent."""
    model, work, x, R = assembly.model, assembly.work, assembly.state.x, assembly.state.R
    rows, system, w = model.bilateral, assembly.problem.bilateral, assembly.problem.w
    target, violation, point, direction = work.bilateral
    if not violation.size:
        return
    row_targets(rows, model.time_laws, t, 0.0, target)
    row_violations(rows, x, R, target[1], violation, point, direction)
    for i in range(violation.size):
        violation[i] = row_velocity(rows, x, R, point, direction, work.free, i)
    whitened_bilateral_rows(model.bodies, rows, x, R, point, direction, system.J)
    factorise_bilateral(w.size, system)
    hold_bilateral(w.size, system, violation, w)
    add_whitened(model.bodies, w, work.free)


def _problem(assembly: Assembly, touching: Integers) -> FrictionArrays:
    """Return the friction problem of the contacts that touch, each with three velocities of its own after the others.

    They are the contact's compliance: a spring that only this contact touches. Their width is 0 at first.
    """
    model, state, work, system = assembly.model, assembly.state, assembly.work, assembly.problem.bilateral
    contacts, nc = model.contacts, touching.size
    n = assembly.problem.w.size + 3 * nc
    problem = friction_arrays(n, nc, runs=3, k=15, band=n, bilateral=system.at.size)
    for name in ("at", "start", "width", "J"):
        getattr(problem.bilateral, name)[:] = getattr(system, name)
    factorise_bilateral(n, problem.bilateral)
    for j, i in enumerate(touching):
        at = (contacts.a[i], contacts.b[i], work.sites.point, work.sites.frame)
        whitened_rows(model.bodies, state.x, state.R, *at, i, problem.rows, j)
        relative_velocity(state.x, state.R, *at, work.free, i, work.q)
    problem.mu[:] = model.laws.mu[touching]
    return problem


def _energy_norm(bodies: Bodies, twist: Array) -> float:
    """Return the square root of twice the kinetic energy."""
    v, spin = twist[:-1, :3], twist[:-1, 3:]
    turning = np.einsum("bi,bij,bj", spin, bodies.inertia, spin)
    return float(np.sqrt(np.sum(bodies.mass[:, None] * v**2) + turning))
