"""The impulses that hold the loads at a pose for a short time, with all contacts equally, and hardly, compliant.

Starting from zero impulses, the interior-point method finds which contacts open, slide and stick, and Newton's method
the last digits. The impulses therefore depend on the pose alone, not on its history.

Both kernels take the gaps and sites of the contacts as `find_contacts` has written them at this pose: with the geometry
of all shapes inside, each of them would take almost twice as long to compile.
"""

import numpy as np

from engine.friction.arrays import CONVERGED, NOT_CONVERGED, Effort, Goal, finish, give_contacts, square, take_contacts
from engine.friction.blocks import BODY, ROW, clear
from engine.friction.interior import BOLD, CONVEX, interior_point
from engine.friction.newton import newton
from engine.friction.solver import solve_friction
from engine.jit import inner, kernel
from engine.kernels.bilateral import find_redundant_rows, hold_joints, row_targets
from engine.kernels.compliance import hold_compression
from engine.kernels.contact_geometry.gaps import passes_by
from engine.kernels.contacts import add_whitened, contact_velocity, press, whitened_rows
from engine.kernels.energy import kinetic_energy
from engine.kernels.loads import apply_loads
from engine.kernels.model import ROLLING
from engine.kernels.motion import free_twist
from engine.kernels.rest import LOADED

HELD, MOVES, UNSOLVED = range(3)

MOVING = 1e-4  # share of the free motion's energy: more than the compliance allows, less than any sliding has
# compliance, as a share of the mean diagonal of the Delassus operator, and the residual to reach with it: the first
# gives the limit to 1e-3 N; the others are for poses at the onset of sliding, where the first one fails
COMPLIANCE, TOLERANCE = (1e-6, 1e-7, 1e-6), (1e-9, 1e-9, 1e-7)
PATIENCE, SHRINKING = 5000, 0.9999  # most reloadings of the springs, while each reduces the energy below this share
BALANCED = 1e-14  # share of the free motion's energy: forces are then accurate to 1e-7
REFINEMENTS = 2  # each reduces the unbalance to a share of the order of the compliance times its amplification
ROUGH = 3.0  # times the tolerance: reached by the interior-point method before rounding stops it
INSIDE, NEAR = 0.1, 1e-4  # share of the load: initial distance inside the cones, from zero and from given impulses
INTERIOR = Effort(0, 60, 12)
CONVEX_TOLERANCE, UNBALANCED = 1e-6, 1e-6  # residual; share of the free motion's energy, far above its error
# the error of forces is the residual divided by the compliance: 1e-9 would leave errors of 0.1 N
LAST_DIGITS, POLISHING = 1e-13, Effort(1, 20, 5)


@kernel
def hold_loads(arrays, phase, t, h, touching_gap):
    """Write the impulses that hold the loads at the current pose into ``work.u``; return status and number of contacts.

    Loads act for the time ``h``, short enough that the free motion has no gyroscopic part; contacts with gaps up to
    ``touching_gap`` touch, and are the first of ``work.chosen`` and the rows of the problem. The status is HELD, MOVES
    (no forces of these contacts hold the loads: the twists are those with which bodies start to move, otherwise 0) or
    UNSOLVED (none were found).
    """
    model, state, work, problem = arrays
    bodies = model.bodies
    falling = _loads_alone(arrays, phase, t, h)
    nc, diagonal = _gather_touching(model, state, work, problem, touching_gap, h)
    status = UNSOLVED
    for attempt in range(len(COMPLIANCE)):
        compliance = COMPLIANCE[attempt] * diagonal
        if not _balance(nc, model.contacts, work, problem, compliance, TOLERANCE[attempt], False):
            continue
        moving = _begun(bodies, state, work, problem)
        if moving > MOVING * falling:
            status = _wait_for_balance(nc, arrays, compliance, TOLERANCE[attempt], moving, falling)
        else:
            status = HELD
            for _ in range(REFINEMENTS):
                if not _balance(nc, model.contacts, work, problem, compliance, TOLERANCE[attempt], True):
                    break
        if status != UNSOLVED:
            break
    if status != MOVES:
        for body in range(bodies.mass.shape[0]):
            for k in range(6):
                state.v[body, k] = 0.0
    for j in range(nc):
        problem.compliance[j] = 0.0  # the contacts of a step are rigid, and it does not set this
    return status, nc


@kernel
def may_hold(arrays, phase, t, h):
    """Return whether forces of the contacts that carried load may hold the loads; if not, no forces in the cones do.

    Without the shift mu |u_T| the friction problem is convex, and bodies move in its solution if and only if the loads
    cannot be balanced. An interior-point method tells after about fifteen steps. What is changed here the next step
    writes anew.
    """
    model, state, work, problem = arrays
    for body in range(state.v.shape[0]):
        for k in range(6):
            work.start.v[body, k] = state.v[body, k]
    falling, left = _loads_alone(arrays, phase, t, h), 0.0
    nc, _ = _gather_touching(model, state, work, problem, -np.inf, h)
    for j in range(nc):
        problem.compliance[j] = 0.0
        for k in range(3):
            problem.r[j, k], problem.q[j, k] = 0.0, work.q[work.chosen[j], k]
    clear(problem.w)
    if nc > 0:
        goal = Goal(CONVEX_TOLERANCE, take_contacts(nc, problem))
        _, left = interior_point(nc, problem, goal, INSIDE, CONVEX, INTERIOR)
    moving = _begun(model.bodies, state, work, problem)
    for body in range(state.v.shape[0]):
        for k in range(6):
            state.v[body, k] = work.start.v[body, k]
    return not (left <= CONVEX_TOLERANCE and moving > UNBALANCED * falling)


@inner
def _loads_alone(arrays, phase, t, h):
    """Write the twists that loads alone cause from rest in a short time; return the energy if joints held nothing."""
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
        target[2, i] = 0.0  # a motion is held where it is
    find_redundant_rows(model.metric, model.bilateral, state, work.bilateral, problem)
    bushings = model.loads.bushings
    hold_joints(bodies, model.bilateral, bushings, state, work.bilateral, problem, work.free, (0.0, 0.5, 0.0))
    return falling


@inner
def _balance(nc, contacts, work, problem, compliance, tolerance, loaded):
    """Write the impulses of compliant contacts into ``work.u``; return whether they were found.

    If ``loaded``, the springs carry the impulses of ``work.u`` before they yield: each repetition reduces the unbalance
    to the share that the compliance has in the whole.
    """
    _set_springs(nc, contacts, work, problem, compliance, loaded)
    if _solve(nc, problem, tolerance, loaded) != CONVERGED:
        return False
    for j in range(nc):
        for k in range(3):
            work.u[work.chosen[j], k] = problem.r[j, k]
    return True


@inner
def _begun(bodies, state, work, problem):
    """Write the twists with which the bodies yield into the state; return their kinetic energy."""
    for body in range(bodies.mass.shape[0]):
        for k in range(6):
            state.v[body, k] = work.free[body, k]
    add_whitened(bodies, problem.w, state.v)
    return kinetic_energy(bodies, state.v)


@inner
def _wait_for_balance(nc, arrays, compliance, tolerance, moving, falling):
    """Distinguish bodies that start to move from contacts too soft for a heavy body; return HELD, MOVES or UNSOLVED.

    The compliance of a contact suits the mean mass, so a much heavier body makes it yield. Springs that already carry
    the load then yield less each time, while a motion that nothing holds stays the same.
    """
    _, state, work, problem = arrays
    bodies = arrays.model.bodies
    for _ in range(PATIENCE):
        if moving <= BALANCED * falling:
            break
        if not _balance(nc, arrays.model.contacts, work, problem, compliance, tolerance, True):
            return UNSOLVED if moving > MOVING * falling else HELD
        before, moving = moving, _begun(bodies, state, work, problem)
        if moving > SHRINKING * before:
            break
    return MOVES if moving > MOVING * falling else HELD


@inner
def _gather_touching(model, state, work, problem, touching_gap, h):
    """Write the rows of the touching contacts; return their number and the mean diagonal of their Delassus operator.

    A solver may leave 1e-27 instead of a zero impulse, so a contact must be closed, or have carried a load. The
    friction of an ideal joint is always there; it acts for the time ``h``. The force of a contact with a stiffness
    follows from its penetration.
    """
    contacts, sites, load, nc, diagonal = model.contacts, work.sites, 0.0, 0, 0.0
    for i in range(work.gap.shape[0]):
        if contacts.bound[i] == 0.0:
            load = max(load, state.r[i, 0])
    for i in range(work.gap.shape[0]):
        touches = state.r[i, 0] > LOADED * load or work.gap[i] <= touching_gap or contacts.bound[i] > 0.0
        if contacts.kind[i] >= ROLLING:  # it resists with what its contact carried
            touches = state.r[i, 0] > 0.0 and contacts.bound[i] > 0.0
        if touches and not passes_by(contacts, sites.frame, i):
            whitened_rows(model.bodies, contacts, state.x, state.R, sites, i, problem.rows, nc)
            contact_velocity(contacts, state.x, state.R, sites, work.free, i, work.q)
            work.chosen[nc], problem.mu[nc] = i, model.laws.mu[i]
            if model.laws.sticking.shape[0] > 0:
                problem.mu[nc] = model.laws.sticking[i]
            if contacts.bound[i] > 0.0:
                press(contacts, i, h, 0.0, problem, nc)
                work.q[i, 0] = problem.q[nc, 0]
            if contacts.stiffness[i] > 0.0:
                hold_compression(model.bodies, contacts, state, work, problem.rows, h, i, nc)
            diagonal += square(problem.rows, nc)
            nc += 1
    return nc, diagonal / max(3 * nc, 1)


@inner
def _set_springs(nc, contacts, work, problem, compliance, loaded):
    """Set the compliance of each contact; if ``loaded``, start from the impulses carried by its spring, ``work.u``."""
    for j in range(nc):
        i, problem.compliance[j] = work.chosen[j], compliance
        for k in range(3):
            problem.r[j, k] = work.u[i, k] if loaded else 0.0
            problem.q[j, k] = work.q[i, k] - compliance * problem.r[j, k]
        if contacts.bound[i] > 0.0:  # a weight presses equally on any spring
            problem.q[j, 0] = work.q[i, 0] * (1 + compliance / problem.rows.G[j, 0, 2 * ROW] ** 2)


@inner
def _solve(nc, p, tolerance, given):
    """Solve the friction problem by Newton's method from given impulses, from inside the cones, or by all methods."""
    goal = Goal(LAST_DIGITS, take_contacts(nc, p))
    rough = Goal(ROUGH * tolerance, goal.scale)
    for interior in range(0 if given else 1, 2 if nc > 0 else 0):
        if interior:
            interior_point(nc, p, rough, NEAR if given else INSIDE, BOLD, INTERIOR)
        _, reached, _ = newton(nc, p, goal, 0.0, 0.0, 0.0, POLISHING)
        if reached <= tolerance:
            finish(nc, p)  # Newton's method, short of its goal, leaves velocities that do not belong to the impulses
            give_contacts(nc, p)
            return CONVERGED
    for j in range(nc):
        for k in range(3):
            p.r[j, k] = 0.0
    status, _, _ = solve_friction(nc, p, tolerance)
    return CONVERGED if status == CONVERGED else NOT_CONVERGED


@kernel
def effect_on_bodies(rows, chosen, effect):
    """Write the effect of forces (N, T1, T2) at some contacts of a friction problem on its unknowns, in mass metric.

    ``effect``, (3 m, n) for m chosen contacts, must contain zeros on entry.
    """
    for j in range(chosen.shape[0]):
        i = chosen[j]
        for side in range(rows.node.shape[1]):
            first = ROW * rows.node[i, side]
            if first >= 0:
                for k in range(3):
                    for a in range(BODY):
                        effect[3 * j + k, first + a] = rows.G[i, k, ROW * side + a]
