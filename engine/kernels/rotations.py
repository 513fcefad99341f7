"""Unit quaternions (w, x, y, z) and rotation matrices, R = Phi(p) of the paper's section 2.2."""

import numpy as np

from engine.jit import inner, kernel


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
