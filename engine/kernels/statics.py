"""The impulses of a short time that hold the loads at a pose: those of contacts that are all equally, hardly compliant.

From zero impulses the interior-point method finds which contacts open, slide and stick, and Newton's method the last
digits. So the impulses follow from the pose alone, not from its history.
"""

from engine.friction.arrays import CONVERGED, NOT_CONVERGED, Effort, Goal, finish, give_contacts, square, take_contacts
from engine.friction.blocks import BODY, ROW
from engine.friction.interior import interior_point
from engine.friction.newton import newton
from engine.friction.solver import solve_friction
from engine.jit import inner, kernel
from engine.kernels.bilateral import row_targets
from engine.kernels.contact_geometry.gaps import find_contacts
from engine.kernels.contacts import add_whitened, relative_velocity, whitened_rows
from engine.kernels.energy import kinetic_energy
from engine.kernels.joints import hold_joints
from engine.kernels.loads import apply_loads
from engine.kernels.motion import free_twist
from engine.kernels.rest import LOADED

HELD, MOVES, UNSOLVED = range(3)

MOVING = 1e-4  # share of the free motion's energy: more than the compliance allows, less than any sliding has
# compliance, as a share of the mean diagonal of the Delassus operator, and the residual to reach with it: the first
# gives the limit to 1e-3 N; the others are for poses at the very edge of sliding, where the first is not solved
COMPLIANCE, TOLERANCE = (1e-6, 1e-7, 1e-6), (1e-9, 1e-9, 1e-7)
REFINEMENTS = 2  # each reduces the unbalance to a share of the order of the compliance times its amplification
ROUGH = 3.0  # times the tolerance: what the interior-point method reaches before rounding stops it
INSIDE, NEAR = 0.1, 1e-4  # share of the load: how far inside the cones it starts, from nothing and with impulses given
INTERIOR_STEPS = 60
# forces are as good as the residual divided by the compliance: 1e-9 would leave errors of 0.1 N
LAST_DIGITS, POLISHING = 1e-13, Effort(1, 20, 5)


@kernel
def hold_loads(arrays, phase, t, h, touching_gap):
    """Write the impulses that hold the loads at the present pose into ``work.u``, contact by contact.

    Parameters
    ----------
    arrays : RunArrays
        At rest. The twists become zero, or those with which the bodies begin to move.
    phase : int
        Number of the phase whose forces and torques act.
    t : float
        Time since the start of the run.
    h : float
        The time in which the loads act; so short that the free motion has no gyroscopic part.
    touching_gap : float
        Contacts open by no more than this length touch.

    Returns
    -------
    status : int
        HELD; MOVES: no forces of the contacts that touch hold the loads; UNSOLVED: none were found.
    nc : int
        Number of contacts that touch: the first of ``work.chosen``. The rows of the friction problem are theirs.
    """
    model, state, work, problem = arrays
    bodies = model.bodies
    for body in range(state.v.shape[0]):
        for k in range(6):
            state.v[body, k] = 0.0
    apply_loads(bodies, model.loads, model.time_laws, state, phase, t, work.wrench, work.vectors)
    free_twist(bodies, state.R, state.v, work.wrench, h, 0.5, False, work.free)
    falling, target = kinetic_energy(bodies, work.free), work.bilateral.target
    row_targets(model.bilateral, model.time_laws, t, 0.0, target)
    for i in range(target.shape[1]):
        target[2, i] = 0.0
    hold_joints(bodies, model.bilateral, state, work.bilateral, problem, work.free, 0.0, 0.5)
    nc, diagonal = _gather_touching(model, state, work, problem, touching_gap)
    status = UNSOLVED
    for attempt in range(len(COMPLIANCE)):
        for refinement in range(1 + REFINEMENTS):
            # the springs gave way by a share of the load: solve again, with springs that already carry the impulses
            _set_springs(nc, work, problem, COMPLIANCE[attempt] * diagonal, refinement > 0)
            if _solve(nc, problem, TOLERANCE[attempt], refinement > 0) != CONVERGED:
                break
            if refinement == 0:
                for body in range(bodies.mass.shape[0]):
                    for k in range(6):
                        state.v[body, k] = work.free[body, k]
                add_whitened(bodies, problem.w, state.v)
                status = MOVES if kinetic_energy(bodies, state.v) > MOVING * falling else HELD
                if status == MOVES:
                    break
                for body in range(bodies.mass.shape[0]):
                    for k in range(6):
                        state.v[body, k] = 0.0
            for j in range(nc):
                for k in range(3):
                    work.u[work.chosen[j], k] = problem.r[j, k]
        if status != UNSOLVED:
            break
    for j in range(nc):
        problem.compliance[j] = 0.0
    return status, nc


@inner
def _gather_touching(model, state, work, problem, touching_gap):
    """Write the rows of the contacts that touch; return their number and the mean diagonal of their Delassus operator.

    A solver may leave 1e-27 of a zero impulse: a contact must be closed, or have carried a load.
    """
    contacts, sites, load, nc, diagonal = model.contacts, work.sites, 0.0, 0, 0.0
    find_contacts(contacts, state.x, state.R, work.gap, sites.point, sites.frame)
    for i in range(work.gap.shape[0]):
        load = max(load, state.r[i, 0])
    for i in range(work.gap.shape[0]):
        if state.r[i, 0] > LOADED * load or work.gap[i] <= touching_gap:
            a, b = contacts.a[i], contacts.b[i]
            whitened_rows(model.bodies, contacts, state.x, state.R, sites, i, problem.rows, nc)
            relative_velocity(state.x, state.R, a, b, sites.point, sites.frame, work.free, i, work.q)
            work.chosen[nc], problem.mu[nc] = i, model.laws.mu[i]
            diagonal += square(problem.rows, nc)
            nc += 1
    return nc, diagonal / max(3 * nc, 1)


@inner
def _set_springs(nc, work, problem, compliance, loaded):
    """Give every contact its compliance; begin from the impulses that its spring carries, ``work.u``, if it does."""
    for j in range(nc):
        i, problem.compliance[j] = work.chosen[j], compliance
        for k in range(3):
            problem.r[j, k] = work.u[i, k] if loaded else 0.0
            problem.q[j, k] = work.q[i, k] - compliance * problem.r[j, k]


@inner
def _solve(nc, p, tolerance, given):
    """Solve the friction problem: by Newton's method if impulses are given, from inside the cones, by all methods."""
    goal = Goal(LAST_DIGITS, take_contacts(nc, p))
    rough = Goal(ROUGH * tolerance, goal.scale)
    for interior in range(0 if given else 1, 2 if nc > 0 else 0):
        if interior:
            interior_point(nc, p, rough, NEAR if given else INSIDE, INTERIOR_STEPS)
        _, reached, _ = newton(nc, p, goal, 0.0, 0.0, 0.0, POLISHING)
        if reached <= tolerance:
            finish(nc, p)  # short of its goal Newton leaves the bodies' velocities of where it began
            give_contacts(nc, p)
            return CONVERGED
    for j in range(nc):
        for k in range(3):
            p.r[j, k] = 0.0
    status, _, _ = solve_friction(nc, p, tolerance)
    return CONVERGED if status == CONVERGED else NOT_CONVERGED


@kernel
def effect_on_bodies(rows, chosen, effect):
    """Write what forces (N, T1, T2) at some contacts of a friction problem do to its unknowns, in the mass metric.

    Parameters
    ----------
    rows : ContactRows
    chosen : (m,) int64 array
        Numbers of contacts.
    effect : (3 m, n) array
        Zeros; written.
    """
    for j in range(chosen.shape[0]):
        i = chosen[j]
        for side in range(rows.node.shape[1]):
            first = ROW * rows.node[i, side]
            if first >= 0:
                for k in range(3):
                    for a in range(BODY):
                        effect[3 * j + k, first + a] = rows.G[i, k, ROW * side + a]
