"""Free motion of the bodies: half a step of displacement, and the twist without contact impulses (eqs. 11-13)."""

import numpy as np

from engine.jit import inner, kernel
from engine.kernels.vectors import rotation_matrix, turn

EULER_STEPS = 4
NOTHING = 1e-150  # in any unit: smaller numbers are rounding errors of 0; arithmetic below 1e-308 is slow


@kernel
def move(state, dt):
    """Displace each body by ``dt`` at its current twist: x += dt v, p <- p exp(dt Omega)."""
    for body in range(state.x.shape[0] - 1):
        v, p = state.v[body], state.p[body]
        for k in range(6):
            if abs(v[k]) < NOTHING:
                v[k] = 0.0
        for k in range(4):
            if abs(p[k]) < NOTHING:
                p[k] = 0.0
        for k in range(3):
            state.x[body, k] += dt * v[k]
        turn(state.p[body], dt * v[3], dt * v[4], dt * v[5])
        rotation_matrix(state.p[body], state.R[body])


@kernel
def free_twist(bodies, R, twist, wrench, h, theta, again, free):
    """Write the twists at the end of a step under the loads alone, from those at its start, into ``free``, (nb + 1, 6).

    The gyroscopic moment is evaluated within the step, I (O+ - O) = h (M - Om x I Om), Om = (1 - theta) O + theta O+:
    with theta = 1/2 this is of second order, and a free body conserves energy and momentum. With ``again``, O+ is taken
    from ``free``, the twists at the end including the impulses of joints, without which the moment is only of first
    order.
    """
    for body in range(bodies.mass.shape[0]):
        v, f, J, Q = twist[body], wrench[body], bodies.inertia[body], R[body]
        a, b, c = v[3], v[4], v[5]
        if again:
            a, b, c = free[body, 3], free[body, 4], free[body, 5]
        for k in range(3):
            free[body, k] = v[k] + h * f[k] / bodies.mass[body]
        m0 = Q[0, 0] * f[3] + Q[1, 0] * f[4] + Q[2, 0] * f[5]
        m1 = Q[0, 1] * f[3] + Q[1, 1] * f[4] + Q[2, 1] * f[5]
        m2 = Q[0, 2] * f[3] + Q[1, 2] * f[4] + Q[2, 2] * f[5]
        for _ in range(1 if again else EULER_STEPS):
            o0 = v[3] + theta * (a - v[3])
            o1 = v[4] + theta * (b - v[4])
            o2 = v[5] + theta * (c - v[5])
            l0 = J[0, 0] * o0 + J[0, 1] * o1 + J[0, 2] * o2
            l1 = J[1, 0] * o0 + J[1, 1] * o1 + J[1, 2] * o2
            l2 = J[2, 0] * o0 + J[2, 1] * o1 + J[2, 2] * o2
            y0 = h * (m0 - (o1 * l2 - o2 * l1))
            y1 = h * (m1 - (o2 * l0 - o0 * l2))
            y2 = h * (m2 - (o0 * l1 - o1 * l0))
            root = bodies.inverse_root[body]  # I^-1 = L^-T L^-1
            z0 = root[0, 0] * y0
            z1 = root[1, 0] * y0 + root[1, 1] * y1
            z2 = root[2, 0] * y0 + root[2, 1] * y1 + root[2, 2] * y2
            a = v[3] + root[0, 0] * z0 + root[1, 0] * z1 + root[2, 0] * z2
            b = v[4] + root[1, 1] * z1 + root[2, 1] * z2
            c = v[5] + root[2, 2] * z2
        free[body, 3], free[body, 4], free[body, 5] = a, b, c


@inner
def impulse_time(rate, h):
    """Return the momentum that a unit force leaves at the end of a step ``h``: ``h`` less the share lost to drag."""
    return -np.expm1(-rate * h) / rate if rate > 0.0 else h


@inner
def damp(twist, free, rate, h):
    """Damp the ``free`` twists, shape (nb + 1, 6), in proportion to the masses: force -rate M v.

    This is exact for a constant force and stable for any rate: v+ = v exp(-rate h) + f/M (1 - exp(-rate h))/rate.
    """
    if rate > 0.0:
        left, gain = np.exp(-rate * h), impulse_time(rate, h) / h
        for body in range(free.shape[0] - 1):
            for k in range(6):
                free[body, k] = left * twist[body, k] + gain * (free[body, k] - twist[body, k])


@inner
def save_start(state, start):
    """Save the pose, twists and impulses at the start of a step."""
    for body in range(state.x.shape[0]):
        row = start.pose[body]
        for k in range(3):
            row[k] = state.x[body, k]
            for j in range(3):
                row[7 + 3 * k + j] = state.R[body, k, j]
        for k in range(4):
            row[3 + k] = state.p[body, k]
        for k in range(6):
            start.v[body, k] = state.v[body, k]
    for i in range(state.r.shape[0]):
        for k in range(3):
            start.r[i, k] = state.r[i, k]
            start.u[i, k] = state.u[i, k]


@inner
def restore_start(state, work):
    """Return to the start of the step; the broad phase must update every contact."""
    start, budget = work.start, work.broad_phase.budget
    for body in range(state.x.shape[0]):
        row = start.pose[body]
        for k in range(3):
            state.x[body, k] = row[k]
            for j in range(3):
                state.R[body, k, j] = row[7 + 3 * k + j]
        for k in range(4):
            state.p[body, k] = row[3 + k]
        for k in range(6):
            state.v[body, k] = start.v[body, k]
    for i in range(state.r.shape[0]):
        budget[i] = 0.0
        for k in range(3):
            state.r[i, k] = start.r[i, k]
            state.u[i, k] = start.u[i, k]


@inner
def fastest_body(bodies, v):
    """Return the largest root mean square speed of any body's mass, sqrt(2 T / m) with its kinetic energy T."""
    fastest = 0.0
    for body in range(bodies.mass.shape[0]):
        t, J, twice = v[body], bodies.inertia[body], 0.0
        for k in range(3):
            twice += bodies.mass[body] * t[k] * t[k]
            for j in range(3):
                twice += t[3 + k] * J[k, j] * t[3 + j]
        fastest = max(fastest, twice / bodies.mass[body])
    return np.sqrt(fastest)


@inner
def fastest_spin(v):
    """Return the largest angular speed of a body."""
    square = 0.0
    for body in range(v.shape[0]):
        square = max(square, v[body, 3] ** 2 + v[body, 4] ** 2 + v[body, 5] ** 2)
    return np.sqrt(square)
