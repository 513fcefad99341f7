"""Contacts as rows of the equations of motion: relative velocities, whitened rows, and the effect of impulses.

For a pin centred in its hole every direction is a normal; its motion selects one of them.
"""

import numpy as np

from engine.friction.blocks import BODY, ROW
from engine.jit import inner, kernel, not_inlined
from engine.kernels.couplings import coupled_rows, coupled_velocity
from engine.kernels.model import COUPLED, ON_BALL, RING_BORE, ROLLING
from engine.kernels.vectors import CENTRED, cross, transport, world_direction

STICKS = 1e-5  # share of the speed that friction takes in a step; the solver leaves less of a joint that sticks


@kernel
def relative_velocity(x, R, a, b, point, frame, twist, i, u):
    """Write the velocity of body a relative to body b at contact i, along (N, T1, T2), into ``u[i]`` (eq. 18)."""
    r0, r1, r2 = 0.0, 0.0, 0.0
    for side in range(2):
        body = a if side == 0 else b
        if body < x.shape[0] - 1:
            v3, v4, v5 = twist[body, 3], twist[body, 4], twist[body, 5]
            o0 = R[body, 0, 0] * v3 + R[body, 0, 1] * v4 + R[body, 0, 2] * v5
            o1 = R[body, 1, 0] * v3 + R[body, 1, 1] * v4 + R[body, 1, 2] * v5
            o2 = R[body, 2, 0] * v3 + R[body, 2, 1] * v4 + R[body, 2, 2] * v5
            d0, d1, d2 = point[i, 0] - x[body, 0], point[i, 1] - x[body, 1], point[i, 2] - x[body, 2]
            sign = 1.0 - 2.0 * side
            r0 += sign * (twist[body, 0] + o1 * d2 - o2 * d1)
            r1 += sign * (twist[body, 1] + o2 * d0 - o0 * d2)
            r2 += sign * (twist[body, 2] + o0 * d1 - o1 * d0)
    for k in range(3):
        u[i, k] = frame[i, k, 0] * r0 + frame[i, k, 1] * r1 + frame[i, k, 2] * r2


@inner
def contact_velocity(contacts, x, R, sites, twist, i, u):
    """Write the velocity of contact i along (N, T1, T2), at its point or by its coupling, into ``u[i]``."""
    relative_velocity(x, R, contacts.a[i], contacts.b[i], sites.point, sites.frame, twist, i, u)
    if contacts.kind[i] == COUPLED:
        u[i, 0] = coupled_velocity(contacts, x, R, twist, i)
    elif contacts.kind[i] >= ROLLING:
        _angular_velocity(contacts, R, sites.frame, twist, i, u)


@not_inlined
def _angular_velocity(contacts, R, frame, twist, i, u):
    """Write the angular velocity of body a relative to body b about the axes of contact i into ``u[i]``."""
    for k in range(3):
        u[i, k] = 0.0
        for side in range(2):
            body, sign = contacts.a[i] if side == 0 else contacts.b[i], 1.0 - 2.0 * side
            if body < R.shape[0] - 1:
                for m in range(3):
                    u[i, k] += sign * _in_body(R, body, frame[i, k], m) * twist[body, 3 + m]


@inner
def _in_body(R, body, t, m):
    """Return a component of a vector in the axes of a body."""
    return t[0] * R[body, 0, m] + t[1] * R[body, 1, m] + t[2] * R[body, 2, m]


@inner
def aim_centred(contacts, state, work, twist, dt, i):
    """Turn contact i's normal against the motion of a pin centred in its hole, so that it touches the side ahead.

    `find_contact` gives such a contact a direction fixed in the body, unrelated to the motion. If a pin crosses its
    play within one step, the impact would depend on that arbitrary direction. Only a ring around its journal and the
    centre of a ball in a socket are changed. Return whether the normal was turned: the contact is centred at the
    current pose, and moves by more than rounding errors in ``dt``, the rest of the step. ``u[i]`` is overwritten.
    """
    kind, radius, hole = contacts.kind[i], contacts.geometry_b[i, 9], 0.0
    if kind == ON_BALL and radius > 0.0 and contacts.geometry_a[i, 9] == 0.0:
        hole = radius  # the gap at the centre is that of the ball plus its radius
    elif kind != RING_BORE:
        return False
    if hole + contacts.clearance[i] - work.gap[i] > CENTRED * radius:
        return False
    a, b, point, frame, u = contacts.a[i], contacts.b[i], work.sites.point, work.sites.frame, work.u
    outward = -1.0 if kind == ON_BALL else 1.0
    for k in range(3):  # the middle, which no rotation moves
        point[i, k] -= outward * radius * frame[i, 0, k]
    relative_velocity(state.x, state.R, a, b, point, frame, twist, i, u)
    if kind == RING_BORE:  # T1 is the axis
        u[i, 1] = 0.0
    speed = np.sqrt(u[i, 0] * u[i, 0] + u[i, 1] * u[i, 1] + u[i, 2] * u[i, 2])
    moves = dt * speed > CENTRED * radius
    if moves:
        for k in range(3):
            way = u[i, 0] * frame[i, 0, k] + u[i, 1] * frame[i, 1, k] + u[i, 2] * frame[i, 2, k]
            frame[i, 0, k] = -way / speed
        if kind == ON_BALL:
            row = contacts.geometry_b[i]
            pole, tangent = world_direction(state.R, b, row, 3), world_direction(state.R, b, row, 6)
            transport(pole, tangent, frame[i, 0], frame[i, 1])
        cross(frame[i, 0], frame[i, 1], frame[i, 2])
    for k in range(3):
        point[i, k] += outward * radius * frame[i, 0, k]
    return moves


@kernel
def whitened_rows(bodies, contacts, x, R, sites, i, rows, j):
    """Write contact i's rows of G M^-1/2, and the nodes that they act on, as contact j of a friction problem.

    M^-1/2 is 1/sqrt(m) for the translation and L^-T for the rotation.
    """
    write_rows(bodies, contacts, x, R, sites, i, rows, j, 3)


@inner
def write_rows(bodies, contacts, x, R, sites, i, rows, j, count):
    """Do so for the first ``count`` rows: only the normal one, or all three."""
    root, point, frame = bodies.inverse_root, sites.point, sites.frame
    rows.pair[j, 0, 1] = rows.pair[j, 1, 0] = contacts.pair[i]
    for side in range(2):
        body, n = contacts.a[i] if side == 0 else contacts.b[i], ROW * side
        rows.node[j, side] = -1
        if body >= bodies.mass.shape[0]:
            continue
        rows.node[j, side] = bodies.node[body]
        sign = 1.0 - 2.0 * side
        s = sign / np.sqrt(bodies.mass[body])
        d0, d1, d2 = point[i, 0] - x[body, 0], point[i, 1] - x[body, 1], point[i, 2] - x[body, 2]
        for k in range(count):
            t0, t1, t2, G = frame[i, k, 0], frame[i, k, 1], frame[i, k, 2], rows.G[j, k]
            m0, m1, m2 = d1 * t2 - d2 * t1, d2 * t0 - d0 * t2, d0 * t1 - d1 * t0
            b0 = R[body, 0, 0] * m0 + R[body, 1, 0] * m1 + R[body, 2, 0] * m2
            b1 = R[body, 0, 1] * m0 + R[body, 1, 1] * m1 + R[body, 2, 1] * m2
            b2 = R[body, 0, 2] * m0 + R[body, 1, 2] * m1 + R[body, 2, 2] * m2
            G[n], G[n + 1], G[n + 2] = s * t0, s * t1, s * t2
            G[n + 3] = sign * root[body, 0, 0] * b0
            G[n + 4] = sign * (root[body, 1, 0] * b0 + root[body, 1, 1] * b1)
            G[n + 5] = sign * (root[body, 2, 0] * b0 + root[body, 2, 1] * b1 + root[body, 2, 2] * b2)
    if contacts.kind[i] >= ROLLING:
        _turn_rows(bodies, contacts, R, frame, i, rows, j)
    if contacts.kind[i] == COUPLED:
        coupled_rows(bodies, contacts, x, R, i, rows, j)
    elif rows.node.shape[1] > 2:
        _add_weight(contacts, i, rows, j)


@not_inlined
def _turn_rows(bodies, contacts, R, frame, i, rows, j):
    """Write the rows of a moment about the axes of contact i in the place of those of a force."""
    for side in range(2):
        body, n, sign = contacts.a[i] if side == 0 else contacts.b[i], ROW * side, 1.0 - 2.0 * side
        if body >= bodies.mass.shape[0]:
            continue
        for k in range(3):
            G = rows.G[j, k]
            for m in range(3):
                G[n + m], G[n + 3 + m] = 0.0, 0.0
                for c in range(m + 1):
                    G[n + 3 + m] += sign * bodies.inverse_root[body, m, c] * _in_body(R, body, frame[i, k], c)


@not_inlined
def _add_weight(contacts, i, rows, j):
    """Write the normal row of a JOINT_FRICTION and its like: it acts on nothing but a weight, as mobile as the joint.

    The weight is pressed with the bound of the friction, see `press`, so that Coulomb's law between the normal impulse
    and that along the joint, with a coefficient of 1, is the law of the joint. A contact with a stiffness has a spring
    in its place, which is rigid until `kernels.compliance` softens it. Other contacts have neither.
    """
    node, square = contacts.weight[i, 0], 0.0
    for s in range(3, rows.node.shape[1]):
        rows.node[j, s] = -1
    rows.node[j, 2] = node
    if node < 0:
        return
    rows.pair[j, 0, 2] = rows.pair[j, 2, 0] = contacts.weight[i, 1]
    rows.pair[j, 1, 2] = rows.pair[j, 2, 1] = contacts.weight[i, 2]
    G = rows.G[j]
    for side in range(2):
        if rows.node[j, side] >= 0 and contacts.bound[i] > 0.0:
            for k in range(BODY):
                square += G[1, ROW * side + k] ** 2
    for k in range(ROW):
        G[0, 2 * ROW + k] = G[1, 2 * ROW + k] = G[2, 2 * ROW + k] = 0.0
    G[0, 2 * ROW] = np.sqrt(square)


@inner
def mobility(bodies, state, sites, body, i):
    """Return the velocity that a unit impulse along the normal of contact i gives a body at its point."""
    if body >= bodies.mass.shape[0]:
        return 0.0
    R, root, N = state.R[body], bodies.inverse_root[body], sites.frame[i, 0]
    d0, d1 = sites.point[i, 0] - state.x[body, 0], sites.point[i, 1] - state.x[body, 1]
    d2 = sites.point[i, 2] - state.x[body, 2]
    m0, m1, m2 = d1 * N[2] - d2 * N[1], d2 * N[0] - d0 * N[2], d0 * N[1] - d1 * N[0]
    spin = 0.0
    for k in range(3):
        turned = 0.0
        for j in range(k + 1):
            turned += root[k, j] * (R[0, j] * m0 + R[1, j] * m1 + R[2, j] * m2)
        spin += turned * turned
    return 1.0 / bodies.mass[body] + spin


@inner
def press(contacts, i, time, speed, problem, j):
    """Press the weight of contact i, contact j of a problem, with its bound for some time; return the impulse.

    The bound is that of a joint that sticks if the joint's ``speed`` is nothing against what friction takes of it.
    """
    g = problem.rows.G[j, 0, 2 * ROW]
    impulse = time * contacts.breakaway[i]
    if abs(speed) > STICKS * impulse * g * g:
        impulse = time * contacts.bound[i]
    problem.q[j, 0] = -impulse * g * g
    return impulse


@kernel
def add_whitened(bodies, w, twist):
    """Add M^-1/2 w to the twists, shape (nb + 1, 6), for the unknowns ``w`` of a friction problem, shape (n,)."""
    root = bodies.inverse_root
    for body in range(bodies.mass.shape[0]):
        s, k = 1 / np.sqrt(bodies.mass[body]), ROW * bodies.node[body]
        twist[body, 0] += s * w[k]
        twist[body, 1] += s * w[k + 1]
        twist[body, 2] += s * w[k + 2]
        twist[body, 3] += root[body, 0, 0] * w[k + 3] + root[body, 1, 0] * w[k + 4] + root[body, 2, 0] * w[k + 5]
        twist[body, 4] += root[body, 1, 1] * w[k + 4] + root[body, 2, 1] * w[k + 5]
        twist[body, 5] += root[body, 2, 2] * w[k + 5]
