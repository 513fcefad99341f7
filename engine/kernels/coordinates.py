"""Coordinates of bodies relative to each other, and their rates: what responses measure, and loads depend on.

Geometry rows are those of `kernels.responses`.
"""

import numpy as np

from engine.jit import inner
from engine.kernels.model import ANGULAR_VELOCITY, VELOCITY
from engine.kernels.vectors import times, to_world, turn_to_world, twist_angle


@inner
def position(kind, body, row, state, p, q):
    """Return a component of the vector to a point from another point, or from an axis at the height of the first point.

    For a VELOCITY, return its rate.
    """
    x, R, v = state.x, state.R, state.v
    to_world(x, R, body[0], row, 0, p)
    to_world(x, R, body[1], row, 6, q)
    d0, d1, d2 = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    turn_to_world(R, body[0], row, 3, p)
    n0, n1, n2 = p[0], p[1], p[2]
    along = d0 * n0 + d1 * n1 + d2 * n2  # 0 for a point, whose axis is the zero vector
    d0, d1, d2 = d0 - along * n0, d1 - along * n1, d2 - along * n2
    turn_to_world(R, body[2], row, 9, p)
    e0, e1, e2 = p[0], p[1], p[2]
    if kind != VELOCITY:
        return d0 * e0 + d1 * e1 + d2 * e2
    p[0], p[1], p[2] = q[0] - d0, q[1] - d1, q[2] - d2  # the point or foot point where the vector starts
    ends = speed_along(x, R, v, body[1], q, e0, e1, e2) - speed_along(x, R, v, body[0], p, e0, e1, e2)
    turning = speed_along(x, R, v, body[2], q, e0, e1, e2) - speed_along(x, R, v, body[2], p, e0, e1, e2)
    sliding = speed_along(x, R, v, body[1], q, n0, n1, n2) - speed_along(x, R, v, body[0], q, n0, n1, n2)
    return ends - turning - sliding * (e0 * n0 + e1 * n1 + e2 * n2)  # the foot point slides along its axis


@inner
def rotation(kind, body, row, state, before, axis):
    """Return the angle of a body about an axis of another since the start, on the branch nearest to ``before``.

    For an ANGULAR_VELOCITY, return its rate.
    """
    a, b, quaternion, R, v = body[0], body[1], state.p, state.R, state.v
    if kind == ANGULAR_VELOCITY:
        turn_to_world(R, a, row, 3, axis)
        return spin_along(R, v, b, axis) - spin_along(R, v, a, axis)
    p = quaternion[a]
    angle = twist_angle((p[0], p[1], p[2], p[3]), times(quaternion[b], row[6:10]), row[3], row[4], row[5])
    return angle - 2 * np.pi * np.round((angle - before) / (2 * np.pi))


@inner
def spin_along(Rs, vs, body, n):
    """Return the component of the body's angular velocity along the world direction n."""
    R, v = Rs[body], vs[body]
    s = 0.0
    for k in range(3):
        s += n[k] * (R[k, 0] * v[3] + R[k, 1] * v[4] + R[k, 2] * v[5])
    return s


@inner
def speed_along(xs, Rs, vs, body, p, d0, d1, d2):
    """Return the velocity of the body's point p (world) along the direction d."""
    R, v, x = Rs[body], vs[body], xs[body]
    o0 = R[0, 0] * v[3] + R[0, 1] * v[4] + R[0, 2] * v[5]
    o1 = R[1, 0] * v[3] + R[1, 1] * v[4] + R[1, 2] * v[5]
    o2 = R[2, 0] * v[3] + R[2, 1] * v[4] + R[2, 2] * v[5]
    y0, y1, y2 = p[0] - x[0], p[1] - x[1], p[2] - x[2]
    return d0 * (v[0] + o1 * y2 - o2 * y1) + d1 * (v[1] + o2 * y0 - o0 * y2) + d2 * (v[2] + o0 * y1 - o1 * y0)
