"""Bushings: six springs and dampers between two bodies, in a frame that turns with the first one.

The displacement of b's point from a's along the axes t of the frame, and the rotation vector phi from the attitude
without force to that of b, also in the frame, are the six coordinates. Their rates are velocities of b relative to a:
along t at b's point, and about the rows of J_l(phi)^-1, since phi' = J_l^-1 omega. So the forces -k q along these
directions are the gradient of the energy k q^2 / 2 at any angle below half a turn.

At a pose the force of the springs is a load, see `kernels.loads`. What it gains or loses until the end of the step, and
the damper, is implicit: a bilateral row with an ease (`engine.friction.bilateral`), held with those of the joints
within the step, and with the contacts. No stiffness limits the step. With q the coordinate at the pose within the step
and u, u' its rate before and after, the whole is

    F = -k (q + h (w^2 u' - (1 - w)^2 u)) - d (w u' + (1 - w) u)

with w = theta where the steps resolve the oscillation: with theta = 1/2 the force of the mean of both ends, which keeps
energy. Elsewhere w is larger: what rings from step to step shrinks to (1 - w) / w in each, and what moves slowly is
damped as if d were larger by (2 w - 1) k h.
"""

import numpy as np

from engine.friction.blocks import BODY, ROW
from engine.jit import inner, not_inlined
from engine.kernels.vectors import dot, times, vector_product, world_direction, world_point

RESOLVED = 1.0  # largest square of the angle, frequency times step, of an oscillation that a step resolves
UNRESOLVED = 0.55  # w of a step that does not
SMALL = 1e-4  # rad; below it the series has all digits


@not_inlined
def find_deflections(bushings, state):
    """Write point, directions and deflections of all bushings at the current pose."""
    x, p, R = state.x, state.p, state.R
    for i in range(bushings.body.shape[0]):
        a, b, axes, way = bushings.body[i, 0], bushings.body[i, 1], bushings.axes[i], bushings.way[i]
        first, second = world_point(x, R, a, bushings.place[i, 0]), world_point(x, R, b, bushings.place[i, 1])
        apart = (second[0] - first[0], second[1] - first[1], second[2] - first[2])
        back = (p[a, 0], -p[a, 1], -p[a, 2], -p[a, 3])
        q = times(back, times(p[b], bushings.turn[i]))
        sign = 1.0 if q[0] >= 0.0 else -1.0
        sine = np.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
        angle = 2.0 * np.arctan2(sine, abs(q[0]))
        f, c = 2.0 * sign, 1.0 / 12.0
        if angle > SMALL:
            f, c = sign * angle / sine, (1.0 - 0.5 * angle / np.tan(0.5 * angle)) / (angle * angle)
        phi = (f * q[1], f * q[2], f * q[3])
        for k in range(3):
            n, t = (axes[3 * k], axes[3 * k + 1], axes[3 * k + 2]), world_direction(R, a, axes, 3 * k)
            once = vector_product(phi, n)
            twice = vector_product(phi, once)
            bushings.off[i, k], bushings.off[i, 3 + k] = dot(t, apart), dot(n, phi)
            for j in range(3):
                way[k, j], bushings.point[i, j] = t[j], second[j]
                n_j = n[0] if j == 0 else n[1] if j == 1 else n[2]
                o_j = once[0] if j == 0 else once[1] if j == 1 else once[2]
                t_j = twice[0] if j == 0 else twice[1] if j == 1 else twice[2]
                way[3 + k, j] = n_j + 0.5 * o_j + c * t_j
            own = world_direction(R, a, way[3 + k], 0)
            way[3 + k, 0], way[3 + k, 1], way[3 + k, 2] = own


@not_inlined
def add_bushings(bushings, state, wrench):
    """Add the forces of the springs at the current pose to the loads, (nb + 1, 6)."""
    find_deflections(bushings, state)
    for i in range(bushings.body.shape[0]):
        point = bushings.point[i]
        for k in range(BODY):
            force, way = -bushings.law[i, k] * bushings.off[i, k], bushings.way[i, k]
            bushings.effort[i, k] = force
            along = (force * way[0], force * way[1], force * way[2])
            for side in range(2):
                body, sign, n = bushings.body[i, side], 2.0 * side - 1.0, along
                if k < 3:
                    arm = (point[0] - state.x[body, 0], point[1] - state.x[body, 1], point[2] - state.x[body, 2])
                    n = vector_product(arm, along)
                    wrench[body, 0] += sign * along[0]
                    wrench[body, 1] += sign * along[1]
                    wrench[body, 2] += sign * along[2]
                wrench[body, 3] += sign * n[0]
                wrench[body, 4] += sign * n[1]
                wrench[body, 5] += sign * n[2]


@inner
def bushing_effort(bushings, i, torque, direction):
    """Return the force, or the torque about its point, of bushing i on body b: along a world direction, or its size.

    It is that of the last step, or of the loads at a pose. A direction of 0 asks for the size.
    """
    first, f0, f1, f2 = 3 if torque else 0, 0.0, 0.0, 0.0
    for k in range(first, first + 3):
        size, way = bushings.effort[i, k], bushings.way[i, k]
        f0, f1, f2 = f0 + size * way[0], f1 + size * way[1], f2 + size * way[2]
    if direction[0] == 0.0 and direction[1] == 0.0 and direction[2] == 0.0:
        return np.sqrt(f0 * f0 + f1 * f1 + f2 * f2)
    return f0 * direction[0] + f1 * direction[1] + f2 * direction[2]


@not_inlined
def bushing_energy(bushings, state):
    """Return the energy that the springs of all bushings hold."""
    find_deflections(bushings, state)
    total = 0.0
    for i in range(bushings.body.shape[0]):
        for k in range(BODY):
            total += 0.5 * bushings.law[i, k] * bushings.off[i, k] ** 2
    return total


# The implicit part, as bilateral rows.


@not_inlined
def aim_rows(bushings, rows, at_pose):
    """Write point and direction of the rows of bushings, as they were last found."""
    for s in range(rows.yielding.shape[0]):
        i, n = rows.yielding[s], rows.coordinate[s]
        for j in range(3):
            at_pose.direction[i, j] = bushings.way[n // BODY, n % BODY, j]
            at_pose.point[i, j] = bushings.point[n // BODY, j]


@inner
def weights(bushings, n, mobility, h, theta):
    """Return what the force of coordinate n has per speed after the pose within the step, and per speed before it.

    ``mobility`` is that of its row.
    """
    k, d = bushings.law[n // BODY, n % BODY], bushings.law[n // BODY, BODY + n % BODY]
    w = theta if (k * h + d) * h * mobility <= RESOLVED else max(theta, UNRESOLVED)
    return w * (k * h * w + d), (1.0 - w) * (k * h * (1.0 - w) - d)


@inner
def mobility_of_row(system, i):
    """Return the velocity along row i that an impulse of 1 gives: the square of the length of the whitened row."""
    total = 0.0
    for k in range(2 * ROW):
        total += system.J[i, k] ** 2
    return total


@inner
def end_of_step(bushings, n, mobility, before, after, h, theta):
    """Write the force along coordinate n in a step, from the rates at its start and its end.

    Return the energy that the step takes beyond what the spring stores and the damper takes.
    """
    i, k = n // BODY, n % BODY
    stiff, damped, at = bushings.law[i, k], bushings.law[i, BODY + k], bushings.off[i, k]
    later, earlier = weights(bushings, n, mobility, h, theta)
    force = -stiff * at - later * after + earlier * before
    bushings.effort[i, k] = force
    begun, end = at - (1.0 - theta) * h * before, at + theta * h * after
    moved = end - begun
    return -force * moved - 0.5 * stiff * (end * end - begun * begun) - damped * moved * moved / h
