"""Newton's method on the barrier of the friction cones, -sum log(s_0^2 - |s_T|^2), over forces s = start + basis y."""

from typing import NamedTuple

import numpy as np

from engine.jit import inner, kernel

NEWTON = 60  # largest number of steps for one barrier weight
CLOSE = 1e-3  # squared Newton decrement below which the weight is changed
INSIDE = 0.95  # largest step, as a share of the distance to the boundary
ROUNDING = 1e-16  # share of the barrier's curvature that keeps Newton's matrix regular at the onset of sliding
GAP = 1e-8  # accuracy of an end of the range, in units of the forces
FIRST, SHARPER = 1.0, 300.0  # first weight of the objective relative to the barrier, and the factor between weights
ROOM = 1e4  # largest |y|: forces would grow without limit where friction wedges
ENDLESS = 1e-2 * ROOM  # beyond this multiple of the forces the range counts as unbounded


class Cones(NamedTuple):
    """Forces s = start + basis y, with one cone s_0 >= |s_T| per contact."""

    start: np.ndarray  # (nc, 3)
    basis: np.ndarray  # (nc, 3, d)


class CentreWork(NamedTuple):
    """Workspace of the functions in this module."""

    s: np.ndarray  # (nc, 3) forces
    ds: np.ndarray  # (nc, 3) their change in a step
    bend: np.ndarray  # (d, d) second derivatives
    slope: np.ndarray  # (d,)
    step: np.ndarray  # (d,)
    y: np.ndarray  # (d,)
    push: np.ndarray  # (d,)


@kernel
def least(cones, way, inside, work):
    """Return the minimum of way . y within the cones, starting at ``inside``; -inf if friction wedges (unbounded).

    ``way`` and the interior point ``inside`` have shape (d,).
    """
    y, push, weight = work.y, work.push, FIRST
    for a in range(way.shape[0]):
        y[a] = inside[a]
    while True:
        for a in range(way.shape[0]):
            push[a] = weight * way[a]
        centre(cones, push, y, work)
        reached = 0.0
        for a in range(way.shape[0]):
            reached += way[a] * y[a]
        if reached < -ENDLESS:
            return -np.inf
        if cones.start.size / weight < GAP:
            return reached
        weight *= SHARPER


@kernel
def centre(cones, push, y, work):
    """Move ``y``, (d,), in place to the minimum of push . y plus the barrier; it starts and stays inside the cones."""
    start, basis = cones
    s, ds, bend, slope, step, _, _ = work
    nc, d = basis.shape[0], basis.shape[2]
    for i in range(nc):
        for k in range(3):
            s[i, k] = start[i, k]
            for a in range(d):
                s[i, k] += basis[i, k, a] * y[a]
    value = _barrier(s, ds, y, step, 0.0)
    for _ in range(NEWTON):
        _newton_system(basis, push, y, s, bend, slope, step)
        decrement = _solve(bend, step)
        if not decrement > CLOSE:
            return
        uphill = 0.0
        for a in range(d):
            uphill += push[a] * step[a]
        for i in range(nc):
            for k in range(3):
                ds[i, k] = 0.0
                for a in range(d):
                    ds[i, k] += basis[i, k, a] * step[a]
        length = min(1.0, INSIDE * _reach(s, ds))
        after = _barrier(s, ds, y, step, length)
        while not after + length * uphill <= value - 1e-4 * length * decrement:
            length *= 0.5
            if length < 1e-12:
                return
            after = _barrier(s, ds, y, step, length)
        value = after
        for a in range(d):
            y[a] += length * step[a]
        for i in range(nc):
            for k in range(3):
                s[i, k] += length * ds[i, k]


@inner
def _newton_system(basis, push, y, s, bend, slope, step):
    """Write the second derivatives (lower half) into ``bend`` and the negative first derivatives into ``step``."""
    nc, d = basis.shape[0], basis.shape[2]
    room = ROOM * ROOM
    for a in range(d):
        room -= y[a] * y[a]
    for a in range(d):
        step[a] = -push[a] - 2 * y[a] / room
        for b in range(a + 1):
            bend[a, b] = 4 * y[a] * y[b] / (room * room)
        bend[a, a] += 2 / room
    for i in range(nc):
        w = 2 / (s[i, 0] * s[i, 0] - s[i, 1] * s[i, 1] - s[i, 2] * s[i, 2])
        for a in range(d):
            slope[a] = w * (s[i, 0] * basis[i, 0, a] - s[i, 1] * basis[i, 1, a] - s[i, 2] * basis[i, 2, a])
            step[a] += slope[a]
            b0, b1, b2 = w * basis[i, 0, a], w * basis[i, 1, a], w * basis[i, 2, a]
            for b in range(a + 1):
                bend[a, b] += slope[a] * slope[b] - b0 * basis[i, 0, b] + b1 * basis[i, 1, b] + b2 * basis[i, 2, b]


@inner
def _solve(A, x):
    """Solve A x = x by Cholesky factorisation; only the lower half of A is read and overwritten. Return x . A^-1 x."""
    d, trace, square = x.shape[0], 0.0, 0.0
    for a in range(d):
        trace += A[a, a]
    for a in range(d):
        for b in range(a + 1):
            t = A[a, b]
            for k in range(b):
                t -= A[a, k] * A[b, k]
            A[a, b] = np.sqrt(max(t, ROUNDING * trace)) if a == b else t / A[b, b]
        t = x[a]
        for k in range(a):
            t -= A[a, k] * x[k]
        x[a] = t / A[a, a]
        square += x[a] * x[a]
    for a in range(d - 1, -1, -1):
        t = x[a]
        for k in range(a + 1, d):
            t -= A[k, a] * x[k]
        x[a] = t / A[a, a]
    return square


@inner
def _barrier(s, ds, y, step, length):
    """Return the barrier at s + length ds; inf outside the cones."""
    room, value = ROOM * ROOM, 0.0
    for a in range(y.shape[0]):
        room -= (y[a] + length * step[a]) ** 2
    if not room > 0.0:
        return np.inf
    for i in range(s.shape[0]):
        s0, s1, s2 = s[i, 0] + length * ds[i, 0], s[i, 1] + length * ds[i, 1], s[i, 2] + length * ds[i, 2]
        det = s0 * s0 - s1 * s1 - s2 * s2
        if not (det > 0.0 and s0 > 0.0):
            return np.inf
        value -= np.log(det)
    return value - np.log(room)


@inner
def _reach(s, ds):
    """Return the largest multiple of ``ds`` by which the forces can move until one reaches the boundary of its cone."""
    reach = np.inf
    for i in range(s.shape[0]):
        a = ds[i, 0] * ds[i, 0] - ds[i, 1] * ds[i, 1] - ds[i, 2] * ds[i, 2]
        b = s[i, 0] * ds[i, 0] - s[i, 1] * ds[i, 1] - s[i, 2] * ds[i, 2]
        c = s[i, 0] * s[i, 0] - s[i, 1] * s[i, 1] - s[i, 2] * s[i, 2]
        root = np.sqrt(max(b * b - a * c, 0.0)) - b  # the smallest positive root of c + 2 b x + a x^2 is c / root
        if root > 0.0:
            reach = min(reach, c / root)
    return reach
