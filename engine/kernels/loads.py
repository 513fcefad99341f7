"""Forces and torques on the bodies: gravity, springs between points, torsion springs, constant loads by phase."""

import numpy as np

from engine.kernels.jit import kernel
from engine.kernels.rotations import times, to_world, turn_to_world, twist_angle


@kernel
def apply_loads(bodies, loads, state, phase, wrench, a, b):
    """Write each body's force and torque about its centre of mass, world axes, shape (nb + 1, 6).

    ``a``, ``b`` are work space, shape (3,).
    """
    for body in range(wrench.shape[0]):
        for k in range(3):
            wrench[body, k] = 0.0
            if body < bodies.mass.shape[0]:
                wrench[body, k] = bodies.mass[body] * loads.gravity[k]
            wrench[body, 3 + k] = 0.0
    _linear_springs(loads, state, wrench, a, b)
    _torsion_springs(loads, state, wrench, a)
    _constant_loads(loads, state, phase, wrench, a, b)


@kernel
def _linear_springs(loads, state, wrench, p, q):
    """Push the two points of each spring apart."""
    for i in range(loads.spring_body.shape[0]):
        force, d0, d1, d2 = spring_force(loads, state, i, p, q)
        _add_force(state.x, loads.spring_body[i, 1], q, force * d0, force * d1, force * d2, wrench)
        _add_force(state.x, loads.spring_body[i, 0], p, -force * d0, -force * d1, -force * d2, wrench)


@kernel
def spring_force(loads, state, i, p, q):
    """Return k (free length - length) - c d(length)/dt of spring i and its direction; ``p``, ``q``: its two points."""
    a, b = loads.spring_body[i, 0], loads.spring_body[i, 1]
    to_world(state.x, state.R, a, loads.spring_point[i], 0, p)
    to_world(state.x, state.R, b, loads.spring_point[i], 3, q)
    d0, d1, d2 = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    length = np.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
    if length == 0.0:
        return 0.0, 0.0, 0.0, 0.0
    d0, d1, d2 = d0 / length, d1 / length, d2 / length
    rate = speed_along(state.x, state.R, state.v, b, q, d0, d1, d2) - speed_along(
        state.x, state.R, state.v, a, p, d0, d1, d2
    )
    law = loads.spring_law[i]
    return law[0] * (law[1] - length) - law[2] * rate, d0, d1, d2


@kernel
def _torsion_springs(loads, state, wrench, axis):
    """Turn body b of each spring about its axis; the opposite turns a."""
    for i in range(loads.torsion_body.shape[0]):
        a, b = loads.torsion_body[i, 0], loads.torsion_body[i, 1]
        torque = spring_torque(loads, state, i, axis)
        for k in range(3):
            wrench[b, 3 + k] += torque * axis[k]
            wrench[a, 3 + k] -= torque * axis[k]


@kernel
def spring_torque(loads, state, i, axis):
    """Return -k (angle - free angle) - c rate of torsion spring i; ``axis``: the world axis, fixed in body a."""
    a, b = loads.torsion_body[i, 0], loads.torsion_body[i, 1]
    law, n = loads.torsion_law[i], loads.torsion_axis[i]
    fa, fb = loads.torsion_frame[i, 0], loads.torsion_frame[i, 1]
    angle = twist_angle(times(state.p[a], fa), times(state.p[b], fb), n[0], n[1], n[2])
    turns = np.round((angle - law[3]) / (2 * np.pi))  # the branch nearest to the angle at the start
    angle -= 2 * np.pi * turns
    _turn(fa, n, axis)
    m0, m1, m2 = axis[0], axis[1], axis[2]
    R = state.R[a]
    for k in range(3):
        axis[k] = R[k, 0] * m0 + R[k, 1] * m1 + R[k, 2] * m2
    rate = spin_along(state.R, state.v, b, axis) - spin_along(state.R, state.v, a, axis)
    return -law[0] * (angle - law[1]) - law[2] * rate


@kernel
def _constant_loads(loads, state, phase, wrench, p, f):
    """Apply the forces and torques of the present phase."""
    for i in range(loads.force_body.shape[0]):
        if not loads.force_phase[i, phase]:
            continue
        body = loads.force_body[i]
        row = loads.force_vector[i]
        to_world(state.x, state.R, body, row, 0, p)
        for part in range(2):
            k = 3 + 3 * part
            f[0], f[1], f[2] = row[k], row[k + 1], row[k + 2]
            if loads.force_in_body[i]:
                turn_to_world(state.R, body, row, k, f)
            if part == 0:
                _add_force(state.x, body, p, f[0], f[1], f[2], wrench)
            else:
                for k in range(3):
                    wrench[body, 3 + k] += f[k]


@kernel
def _add_force(x, body, p, f0, f1, f2, wrench):
    d0, d1, d2 = p[0] - x[body, 0], p[1] - x[body, 1], p[2] - x[body, 2]
    wrench[body, 0] += f0
    wrench[body, 1] += f1
    wrench[body, 2] += f2
    wrench[body, 3] += d1 * f2 - d2 * f1
    wrench[body, 4] += d2 * f0 - d0 * f2
    wrench[body, 5] += d0 * f1 - d1 * f0


@kernel
def spin_along(Rs, vs, body, n):
    """Angular velocity about the world direction n."""
    R, v = Rs[body], vs[body]
    s = 0.0
    for k in range(3):
        s += n[k] * (R[k, 0] * v[3] + R[k, 1] * v[4] + R[k, 2] * v[5])
    return s


@kernel
def speed_along(xs, Rs, vs, body, p, d0, d1, d2):
    """Velocity of the body's point p (world) along the direction d."""
    R, v, x = Rs[body], vs[body], xs[body]
    o0 = R[0, 0] * v[3] + R[0, 1] * v[4] + R[0, 2] * v[5]
    o1 = R[1, 0] * v[3] + R[1, 1] * v[4] + R[1, 2] * v[5]
    o2 = R[2, 0] * v[3] + R[2, 1] * v[4] + R[2, 2] * v[5]
    y0, y1, y2 = p[0] - x[0], p[1] - x[1], p[2] - x[2]
    return d0 * (v[0] + o1 * y2 - o2 * y1) + d1 * (v[1] + o2 * y0 - o0 * y2) + d2 * (v[2] + o0 * y1 - o1 * y0)


@kernel
def _turn(p, v, out):
    """Write the vector v turned by the quaternion p."""
    c0, c1, c2 = p[2] * v[2] - p[3] * v[1], p[3] * v[0] - p[1] * v[2], p[1] * v[1] - p[2] * v[0]
    out[0] = v[0] + 2 * (p[0] * c0 + p[2] * c2 - p[3] * c1)
    out[1] = v[1] + 2 * (p[0] * c1 + p[3] * c0 - p[1] * c2)
    out[2] = v[2] + 2 * (p[0] * c2 + p[1] * c1 - p[2] * c0)
