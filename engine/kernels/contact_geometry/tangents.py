"""The two tangents of a contact's local frame: the first one, and the second one that completes the frame."""

import numpy as np

from engine.jit import inner
from engine.kernels.vectors import split

BACK = 1e-6  # squared angle from the back of a face within which the tangent is not rotated with the normal


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
