"""Vectors, quaternions and rotation matrices.

Vectors of three numbers are tuples: values in registers, for kernels without an array to write them to. Tangents of a
contact's frame and points of a body are written into arrays.
"""

import numpy as np

from engine.jit import inner, kernel

NOWHERE = 1e-150  # smallest length whose square does not underflow; a shorter vector has no direction
CENTRED = 1e-10  # share of a radius below which rounding, which depends on the world's axes, would choose a direction

BACK = 1e-6  # squared angle from the back of a face within which the tangent is not rotated with the normal


@inner
def dot(a, b):
    """Return the scalar product of a and b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner
def vector_product(a, b):
    """Return the vector product of a and b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@inner
def split(v, axis):
    """Return the component of v along a unit vector, a number, and the remainder perpendicular to it, a vector."""
    along = dot(v, axis)
    return along, (v[0] - along * axis[0], v[1] - along * axis[1], v[2] - along * axis[2])


@inner
def world_direction(R, body, row, k):
    """Return the world components of the body's direction ``row[k : k + 3]``: R d."""
    a, b, c, M = row[k], row[k + 1], row[k + 2], R[body]
    return (
        M[0, 0] * a + M[0, 1] * b + M[0, 2] * c,
        M[1, 0] * a + M[1, 1] * b + M[1, 2] * c,
        M[2, 0] * a + M[2, 1] * b + M[2, 2] * c,
    )


@inner
def world_point(x, R, body, row):
    """Return the world position of the body's point ``row[0:3]``: x + R p."""
    a, b, c, M, o = row[0], row[1], row[2], R[body], x[body]
    return (
        o[0] + M[0, 0] * a + M[0, 1] * b + M[0, 2] * c,
        o[1] + M[1, 0] * a + M[1, 1] * b + M[1, 2] * c,
        o[2] + M[2, 0] * a + M[2, 1] * b + M[2, 2] * c,
    )


@inner
def body_components(R, body, v):
    """Return the components in body axes of a world vector: R' v."""
    M = R[body]
    return (
        M[0, 0] * v[0] + M[1, 0] * v[1] + M[2, 0] * v[2],
        M[0, 1] * v[0] + M[1, 1] * v[1] + M[2, 1] * v[2],
        M[0, 2] * v[0] + M[1, 2] * v[1] + M[2, 2] * v[2],
    )


# The two tangents of a contact's local frame: the first one, and the second one that completes the frame.


@inner
def transport(pole, t, n, out):
    """Write into ``out`` the tangent ``t`` rotated by the shortest rotation that takes ``pole`` to ``n``.

    The tangent of a face at ``pole`` thus rotates around the edges without a jump, except at the very back.
    """
    s0, s1, s2 = pole[0] + n[0], pole[1] + n[1], pole[2] + n[2]
    square = s0 * s0 + s1 * s1 + s2 * s2
    if square > BACK:
        k = 2 * (t[0] * s0 + t[1] * s1 + t[2] * s2) / square
        out[0], out[1], out[2] = t[0] - k * s0, t[1] - k * s1, t[2] - k * s2
    else:
        _, (t0, t1, t2) = split(t, n)
        k = 1 / np.sqrt(t0 * t0 + t1 * t1 + t2 * t2)
        out[0], out[1], out[2] = k * t0, k * t1, k * t2


@inner
def cross(a, b, out):
    """Write the vector product of a and b."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


# Unit quaternions (w, x, y, z) and rotation matrices, R = Phi(p) of the paper's section 2.2.


@kernel
def rotation_matrix(p, R):
    """Write the rotation matrix of the unit quaternion ``p``, shape (4,), into ``R``, shape (3, 3): Phi(p)."""
    w, x, y, z = p[0], p[1], p[2], p[3]
    R[0, 0] = 1 - 2 * (y * y + z * z)
    R[0, 1] = 2 * (x * y - w * z)
    R[0, 2] = 2 * (x * z + w * y)
    R[1, 0] = 2 * (x * y + w * z)
    R[1, 1] = 1 - 2 * (x * x + z * z)
    R[1, 2] = 2 * (y * z - w * x)
    R[2, 0] = 2 * (x * z - w * y)
    R[2, 1] = 2 * (y * z + w * x)
    R[2, 2] = 1 - 2 * (x * x + y * y)


@inner
def turn(p, a, b, c):
    """Rotate the quaternion ``p`` in place by the body-frame rotation vector (a, b, c) [rad]: p <- p exp(.)."""
    angle = np.sqrt(a * a + b * b + c * c)
    if angle > 1e-8:
        s = np.sin(0.5 * angle) / angle
        w = np.cos(0.5 * angle)
    else:
        s = 0.5 - angle * angle / 48
        w = 1 - angle * angle / 8
    x, y, z = s * a, s * b, s * c
    p0 = p[0] * w - p[1] * x - p[2] * y - p[3] * z
    p1 = p[0] * x + p[1] * w + p[2] * z - p[3] * y
    p2 = p[0] * y - p[1] * z + p[2] * w + p[3] * x
    p3 = p[0] * z + p[1] * y - p[2] * x + p[3] * w
    n = 1 / np.sqrt(p0 * p0 + p1 * p1 + p2 * p2 + p3 * p3)
    p[0], p[1], p[2], p[3] = n * p0, n * p1, n * p2, n * p3


@inner
def times(p, q):
    """Return the quaternion product p q as a tuple."""
    return (
        p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
        p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
        p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
        p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0],
    )


@inner
def twist_angle(pa, pb, n0, n1, n2):
    """Return the angle [rad] in (-2 pi, 2 pi) of the rotation from ``pa`` to ``pb`` about the axis n of frame a."""
    w = pa[0] * pb[0] + pa[1] * pb[1] + pa[2] * pb[2] + pa[3] * pb[3]
    x = pa[0] * pb[1] - pa[1] * pb[0] - pa[2] * pb[3] + pa[3] * pb[2]
    y = pa[0] * pb[2] + pa[1] * pb[3] - pa[2] * pb[0] - pa[3] * pb[1]
    z = pa[0] * pb[3] - pa[1] * pb[2] + pa[2] * pb[1] - pa[3] * pb[0]
    return 2 * np.arctan2(x * n0 + y * n1 + z * n2, w)


@inner
def to_world(x, R, body, row, k, out):
    """Write into ``out`` the world position of the body's point ``row[k : k + 3]``: x + R p."""
    a, b, c = row[k], row[k + 1], row[k + 2]
    for i in range(3):
        out[i] = x[body, i] + R[body, i, 0] * a + R[body, i, 1] * b + R[body, i, 2] * c


@inner
def turn_to_world(R, body, row, k, out):
    """Write into ``out`` the world components of the body's direction ``row[k : k + 3]``: R d."""
    a, b, c = row[k], row[k + 1], row[k + 2]
    for i in range(3):
        out[i] = R[body, i, 0] * a + R[body, i, 1] * b + R[body, i, 2] * c
