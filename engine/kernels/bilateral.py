"""Bilateral constraints of ideal joints and prescribed motions, one scalar row each (paper, eqs. 14-16).

====  ==========================================  ===================================================================
kind  geometry, centre of mass and body axes      violation
====  ==========================================  ===================================================================
0     SLIDE: P_a (0:3), t in a (3:6), P_b (6:9)   t . (P_b - P_a) - target
1     TURN: d_a (0:3), t in a (3:6), d_b (6:9)    arm (angle from d_a to d_b about t - target)
====  ==========================================  ===================================================================

Both describe a velocity of b relative to a: along t at the common point P_b, or arm times the angular velocity about t.
"""

import numpy as np

from engine.friction.bilateral import factorise_bilateral, hold_bilateral
from engine.friction.blocks import BODY, ROW
from engine.friction.redundancy import mark_redundant
from engine.jit import inner, kernel, not_inlined
from engine.kernels.bushings import aim_rows, end_of_step, mobility_of_row, weights
from engine.kernels.contacts import add_whitened
from engine.kernels.loads import goes_on, smooth_change, time_law, time_law_rate
from engine.kernels.model import SLIDE
from engine.kernels.motion import NOTHING, impulse_time
from engine.kernels.vectors import to_world, turn_to_world

# Share of a row's length that the others must leave for it to count: ten times what joints may be off at the start, in
# rad, see `engine.assembly.start`. Axes of a closed linkage that agree to within that hold no more than exact ones.
REDUNDANT = 1e-4
JUMP = 1e-6  # share of the speed of a motion beyond which a sudden change is an impact


@kernel
def row_targets(rows, time_laws, t, h, target):
    """Write into ``target``, (3, nt), each row's target at t and at t + h, and its rate at t + h.

    The time t is that since the start of the run. An inactive row keeps its offset and has rate 0.
    """
    for i in range(rows.kind.shape[0]):
        target[0, i], target[1, i], target[2, i] = rows.offset[i], rows.offset[i], 0.0
        law = rows.law[i]
        if law >= 0 and rows.acts[i]:
            target[0, i] += time_law(time_laws, law, t)
            target[1, i] += time_law(time_laws, law, t + h)
            target[2, i] = time_law_rate(time_laws, law, t + h)


@kernel
def row_violations(rows, x, R, target, violation, point, direction):
    """Write the violation of each row, its point P_b and its world direction t at the pose (x, R).

    Violations are lengths; targets, (nt,), are lengths or angles. An inactive row gets the direction 0 and thus
    constrains nothing.
    """
    for i in range(violation.shape[0]):
        a, b, row, t, p = rows.a[i], rows.b[i], rows.geometry[i], direction[i], point[i]
        if not rows.acts[i]:
            violation[i], t[0], t[1], t[2] = 0.0, 0.0, 0.0, 0.0
            continue
        turn_to_world(R, a, row, 3, t)
        if rows.kind[i] == SLIDE:
            to_world(x, R, a, row, 0, p)
            p0, p1, p2 = p[0], p[1], p[2]
            to_world(x, R, b, row, 6, p)
            violation[i] = t[0] * (p[0] - p0) + t[1] * (p[1] - p1) + t[2] * (p[2] - p2) - target[i]
        else:
            turn_to_world(R, a, row, 0, p)
            d0, d1, d2 = p[0], p[1], p[2]
            turn_to_world(R, b, row, 6, p)
            e0, e1, e2 = p[0], p[1], p[2]
            sine = t[0] * (d1 * e2 - d2 * e1) + t[1] * (d2 * e0 - d0 * e2) + t[2] * (d0 * e1 - d1 * e0)
            cosine = d0 * e0 + d1 * e1 + d2 * e2
            cs, sn = np.cos(target[i]), np.sin(target[i])
            violation[i] = rows.arm[i] * np.arctan2(sine * cs - cosine * sn, cosine * cs + sine * sn)


@inner
def find_redundant_rows(metric, rows, state, at_pose, problem):
    """Mark the rows that closed loops hold already at the current pose, where the joints are exact.

    The ``metric`` is that of bodies with equal masses, because what a joint holds does not depend on them. The
    bilateral system of ``problem`` is overwritten.
    """
    if rows.closed[0]:
        c, point, direction = at_pose.violation, at_pose.point, at_pose.direction
        row_violations(rows, state.x, state.R, at_pose.target[1], c, point, direction)
        whitened_bilateral_rows(metric, rows, state.x, state.R, point, direction, problem.bilateral.J)
        mark_redundant(problem.system, problem.bilateral, REDUNDANT, at_pose.redundant)


@inner
def rows_at_pose(rows, state, at_pose):
    """Write violations, points and directions at the current pose; the direction of a redundant row is 0."""
    row_violations(rows, state.x, state.R, at_pose.target[1], at_pose.violation, at_pose.point, at_pose.direction)
    if rows.closed[0]:
        for i in range(at_pose.redundant.shape[0]):
            if at_pose.redundant[i]:
                at_pose.direction[i, 0] = at_pose.direction[i, 1] = at_pose.direction[i, 2] = 0.0


@kernel
def slack(metric, rows, at_pose, i):
    """Return the violation that row i may have: what a redundant one of a joint can gain where others hold exactly."""
    if not at_pose.redundant[i] or rows.law[i] >= 0:
        return 0.0
    size = 0.0
    for side in range(2):
        body = rows.a[i] if side == 0 else rows.b[i]
        if body < metric.mass.shape[0]:
            size = max(size, 1 / metric.inverse_root[body, 0, 0])
    return REDUNDANT * size


@inner
def begin_rows(rows, state, at_pose, phase):
    """Activate the rows that act in ``phase``; a motion that begins with it starts from the current coordinate.

    If motions are read, ``speed`` gets the rate of those that begin.
    """
    violation, target = at_pose.violation, at_pose.target[1]
    # with target 0 the violation is the coordinate; only the motions that begin need it
    for i in range(violation.shape[0]):
        begins = phase > 0 and rows.phase[i, phase] and not rows.phase[i, phase - 1]
        rows.acts[i], target[i] = begins or (phase == 0 and rows.read[0] and rows.phase[i, 0]), 0.0
    row_violations(rows, state.x, state.R, target, violation, at_pose.point, at_pose.direction)
    for i in range(violation.shape[0]):
        if rows.acts[i] and rows.read[0]:
            rate = row_velocity(rows, state.x, state.R, at_pose.point, at_pose.direction, state.v, i)
            at_pose.speed[i] = rate / rows.arm[i]
        if rows.acts[i] and phase > 0:
            rows.offset[i] = violation[i] / rows.arm[i]
        rows.acts[i] = rows.phase[i, phase]
        if not rows.acts[i]:
            rows.offset[i] = 0.0


@kernel
def row_velocity(rows, x, R, point, direction, twist, i):
    """Return the rate of row i's violation for the twists, shape (nb + 1, 6), with its target at rest."""
    rate, t0, t1, t2 = 0.0, direction[i, 0], direction[i, 1], direction[i, 2]
    for side in range(2):
        body = rows.a[i] if side == 0 else rows.b[i]
        if body >= x.shape[0] - 1:
            continue
        sign = 2.0 * side - 1.0
        v3, v4, v5 = twist[body, 3], twist[body, 4], twist[body, 5]
        o0 = R[body, 0, 0] * v3 + R[body, 0, 1] * v4 + R[body, 0, 2] * v5
        o1 = R[body, 1, 0] * v3 + R[body, 1, 1] * v4 + R[body, 1, 2] * v5
        o2 = R[body, 2, 0] * v3 + R[body, 2, 1] * v4 + R[body, 2, 2] * v5
        if rows.kind[i] == SLIDE:
            d0, d1, d2 = point[i, 0] - x[body, 0], point[i, 1] - x[body, 1], point[i, 2] - x[body, 2]
            rate += sign * (
                t0 * (twist[body, 0] + o1 * d2 - o2 * d1)
                + t1 * (twist[body, 1] + o2 * d0 - o0 * d2)
                + t2 * (twist[body, 2] + o0 * d1 - o1 * d0)
            )
        else:
            rate += sign * rows.arm[i] * (t0 * o0 + t1 * o1 + t2 * o2)
    return rate


@kernel
def whitened_bilateral_rows(bodies, rows, x, R, point, direction, J):
    """Write each row times M^-1/2 into ``J``, shape (nt, 16): six columns and two zeros per body, a's first."""
    root = bodies.inverse_root
    for i in range(rows.kind.shape[0]):
        t0, t1, t2 = direction[i, 0], direction[i, 1], direction[i, 2]
        for side in range(2):
            body, n = rows.a[i] if side == 0 else rows.b[i], ROW * side
            if body >= bodies.mass.shape[0]:
                continue
            sign = 2.0 * side - 1.0
            f, m0, m1, m2 = 0.0, rows.arm[i] * t0, rows.arm[i] * t1, rows.arm[i] * t2
            if rows.kind[i] == SLIDE:
                d0, d1, d2 = point[i, 0] - x[body, 0], point[i, 1] - x[body, 1], point[i, 2] - x[body, 2]
                f, m0, m1, m2 = 1.0, d1 * t2 - d2 * t1, d2 * t0 - d0 * t2, d0 * t1 - d1 * t0
            s = sign * f / np.sqrt(bodies.mass[body])
            b0 = R[body, 0, 0] * m0 + R[body, 1, 0] * m1 + R[body, 2, 0] * m2
            b1 = R[body, 0, 1] * m0 + R[body, 1, 1] * m1 + R[body, 2, 1] * m2
            b2 = R[body, 0, 2] * m0 + R[body, 1, 2] * m1 + R[body, 2, 2] * m2
            J[i, n], J[i, n + 1], J[i, n + 2] = s * t0, s * t1, s * t2
            J[i, n + 3] = sign * root[body, 0, 0] * b0
            J[i, n + 4] = sign * (root[body, 1, 0] * b0 + root[body, 1, 1] * b1)
            J[i, n + 5] = sign * (root[body, 2, 0] * b0 + root[body, 2, 1] * b1 + root[body, 2, 2] * b2)


# -- joint stages -----------------------------------------------------------------------------------------------------
#
# Twists consistent with ideal joints and prescribed motions, before the contacts and after a step.
#
# Within the step the mean velocity satisfies the constraint, J (theta v+ + (1 - theta) v) = s' with J at mid-step; at
# the end the velocities themselves satisfy it, J v+ = s' with J at the new pose (with multipliers of their own, as in
# the RATTLE scheme). With theta = 1/2 this is of second order and joints do no work; J v+ = s' with J at mid-step alone
# would lose energy in every turn.


@inner
def hold_joints(bodies, rows, bushings, state, at_pose, problem, twist, times):
    """Change ``twist``, with the least kinetic energy, so that the joints hold at the current pose.

    ``times`` are the length of the step, theta, and how long an impulse acts. The mean velocity of the step must
    satisfy the joints, with the twists at its start in ``state``; if its length is 0, the velocity at the end must.
    Bushings yield within a step only. The bilateral system of ``problem`` and its unknowns are overwritten.
    Return the kinetic energy that joints remove from the velocities at the end; what they do to a mean one is no work.
    """
    x, R = state.x, state.R
    h, theta, _ = times
    if at_pose.violation.shape[0] == 0:
        return 0.0
    rows_at_pose(rows, state, at_pose)
    c, point, direction = at_pose.violation, at_pose.point, at_pose.direction
    yields = h > 0.0 and rows.yielding.shape[0] > 0
    if yields:
        aim_rows(bushings, rows, at_pose)
    for i in range(c.shape[0]):
        c[i] = row_velocity(rows, x, R, point, direction, twist, i)
        if h > 0.0:
            mean = rows.arm[i] * (at_pose.target[1, i] - at_pose.target[0, i]) / h
            c[i] -= (mean - (1 - theta) * row_velocity(rows, x, R, point, direction, state.v, i)) / theta
        else:
            c[i] -= rows.arm[i] * at_pose.target[2, i]
        if abs(c[i]) < NOTHING:
            c[i] = 0.0
    whitened_bilateral_rows(bodies, rows, x, R, point, direction, problem.bilateral.J)
    if yields:
        _soften(rows, bushings, state, at_pose, problem.bilateral, twist, times)
    factorise_bilateral(problem.system, problem.bilateral)
    hold_bilateral(problem.system, problem.bilateral, c, problem.w)
    add_whitened(bodies, problem.w, twist)
    if rows.read[0]:
        for i in range(c.shape[0]):
            impulse = _impulse(problem, i)
            if h > 0.0:
                at_pose.impulse[i] = impulse
            else:
                at_pose.impulse[i] += impulse
                at_pose.work[i] += impulse * (rows.arm[i] * at_pose.target[2, i] + 0.5 * c[i])
    if h > 0.0:
        return 0.0
    driven = False
    for i in range(c.shape[0]):
        if rows.law[i] >= 0 and rows.acts[i]:
            c[i], driven = 0.0, True
    if driven:  # the speed that a motion gives is no loss, even where it jumps
        hold_bilateral(problem.system, problem.bilateral, c, problem.w)
    removed = 0.0
    for body in range(bodies.mass.shape[0]):
        for k in range(BODY):
            removed += 0.5 * problem.w[ROW * bodies.node[body] + k] ** 2
    return removed


# -- bushings ----------------------------------------------------------------------------------------------------------


@not_inlined
def _soften(rows, bushings, state, at_pose, system, twist, times):
    """Give the rows of bushings their ease, and the velocities that their impulses answer to."""
    point, direction = at_pose.point, at_pose.direction
    h, theta, time = times
    for s in range(rows.yielding.shape[0]):
        i = rows.yielding[s]
        before = row_velocity(rows, state.x, state.R, point, direction, state.v, i)
        after = row_velocity(rows, state.x, state.R, point, direction, twist, i)
        later, earlier = weights(bushings, rows.coordinate[s], mobility_of_row(system, i), h, theta)
        system.ease[i] = 1.0 / (time * later)
        at_pose.violation[i] = after - earlier / later * before


@not_inlined
def finish_bushings(rows, bushings, state, at_pose, system, twist, h, theta):
    """Write the forces of bushings in a step ``h``; return the energy that it takes beyond springs and dampers.

    The rows are those within the step, and ``twist`` has the twists at its start.
    """
    point, direction, total = at_pose.point, at_pose.direction, 0.0
    for s in range(rows.yielding.shape[0]):
        i = rows.yielding[s]
        before = row_velocity(rows, state.x, state.R, point, direction, twist, i)
        after = row_velocity(rows, state.x, state.R, point, direction, state.v, i)
        total += end_of_step(bushings, rows.coordinate[s], mobility_of_row(system, i), before, after, h, theta)
    return total


# -- forces of prescribed motions --------------------------------------------------------------------------------------
#
# The impulse of a row in a step is the sum of those of the two joint stages and of the friction problem, in which the
# rows are held. The first and the last act along the displacement of the step, the second one at its end, between the
# velocities before and after it. So the work of all loads, contacts, joints and motions is the change of energy.


@inner
def _impulse(problem, i):
    """Return the impulse on row i's body b that belongs to the unknowns ``w`` of a problem with bilateral rows."""
    rows = problem.bilateral
    return -problem.w[rows.at[i]] / rows.length[i] if rows.length[i] > 0.0 else 0.0


@inner
def add_contact_part(rows, at_pose, problem, nc, h, rate):
    """Add what holds the rows against ``nc`` contacts, and write the work along the displacement of the step ``h``.

    Forces act during the whole step, of which drag with this ``rate`` leaves a share.
    """
    share = impulse_time(rate, h) / h
    for i in range(at_pose.impulse.shape[0]):
        if nc > 0:
            at_pose.impulse[i] += _impulse(problem, i)
        at_pose.impulse[i] /= share
        at_pose.work[i] = at_pose.impulse[i] * rows.arm[i] * (at_pose.target[1, i] - at_pose.target[0, i]) / h


@inner
def read_motions(rows, time_laws, at_pose, t, h):
    """Write the force or torque of each motion in the step of length ``h`` that ended at time ``t``.

    Where the speed of a motion jumps, as at the beginning of a ramp, the impulse is no force: it keeps its value.
    """
    for i in range(rows.kind.shape[0]):
        if rows.law[i] < 0:
            continue
        if not rows.acts[i]:
            at_pose.force[i] = at_pose.work[i] = 0.0
            continue
        rate, before = at_pose.target[2, i], at_pose.speed[i]
        jump = rate - before - smooth_change(time_laws, rows.law[i], t - h, h)
        if abs(jump) <= JUMP * (abs(rate) + abs(before)) + NOTHING:
            at_pose.force[i] = at_pose.impulse[i] * rows.arm[i] / h
        at_pose.speed[i] = rate


@inner
def some_motion_goes_on(rows, time_laws, t):
    """Return whether a motion that acts will still move after time ``t``."""
    found = False
    for i in range(rows.kind.shape[0]):
        found = found or (rows.law[i] >= 0 and rows.acts[i] and goes_on(time_laws, rows.law[i], t))
    return found
