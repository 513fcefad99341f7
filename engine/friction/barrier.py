"""Newton's method on the barrier of the friction cones, -sum log(s_0^2 - |s_T|^2), over forces s = start + basis y."""

from typing import NamedTuple

import numpy as np

from engine.jit import inner, kernel
from engine.jit.lanes import LANES, read, spread, write

NEWTON = 60  # largest number of steps for one barrier weight
CLOSE = 1e-3  # squared Newton decrement below which the weight is changed
INSIDE = 0.95  # largest step, as a share of the distance to the boundary
ROUNDING = 1e-16  # share of the barrier's curvature that keeps Newton's matrix regular at the onset of sliding
GAP = 1e-8  # accuracy of an end of the range, in units of the forces
FIRST, SHARPER = 1.0, 300.0  # first weight of the objective relative to the barrier, and the factor between weights
ROOM = 1e4  # largest |y|: forces would grow without limit where friction wedges
ENDLESS = 1e-2 * ROOM  # beyond this multiple of the forces the range counts as unbounded


class Cones(NamedTuple):
    """Forces s = start + basis y, with one cone s_0 >= |s_T| per contact; zeros fill up groups of eight."""

    start: np.ndarray  # (m,), three numbers per contact
    basis: np.ndarray  # (nc, 3, e)
    across: np.ndarray  # (d, m), the same transposed


class CentreWork(NamedTuple):
    """Workspace of the functions in this module; zeros fill up groups of eight, as in `Cones`."""

    s: np.ndarray  # (m,) forces
    ds: np.ndarray  # (m,) their change in a step
    bend: np.ndarray  # (d, e) second derivatives
    column: np.ndarray  # (e,) one column of its factor
    slope: np.ndarray  # (e,)
    step: np.ndarray  # (e,)
    y: np.ndarray  # (e,)
    push: np.ndarray  # (e,)


@kernel
def least(cones, way, inside, work):
    """Return the minimum of way . y within the cones, starting at ``inside``; -inf if friction wedges (unbounded).

    ``way`` has shape (d,), the interior point ``inside`` (e,).
    """
    y, push, weight = work.y, work.push, FIRST
    for a in range(y.shape[0]):
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
        if 3 * cones.basis.shape[0] / weight < GAP:
            return reached
        weight *= SHARPER


@kernel
def centre(cones, push, y, work):
    """Move ``y``, (e,), in place to the minimum of push . y plus the barrier; it starts and stays inside the cones."""
    start, basis, across = cones
    s, ds, bend, column, slope, step, _, _ = work
    nc, d = basis.shape[0], across.shape[0]
    for j in range(0, s.shape[0], LANES):
        forces = read(start, j)
        for a in range(d):
            forces += read(across[a], j) * y[a]
        write(forces, s, j)
    value = _barrier(nc, s, ds, y, step, 0.0)
    for _ in range(NEWTON):
        _newton_system(nc, basis, push, y, s, bend, slope, step)
        decrement = _solve(bend, column, step)
        if not decrement > CLOSE:
            return
        uphill = 0.0
        for a in range(d):
            uphill += push[a] * step[a]
        for j in range(0, s.shape[0], LANES):
            change = spread(0.0)
            for a in range(d):
                change += read(across[a], j) * step[a]
            write(change, ds, j)
        length = min(1.0, INSIDE * _reach(nc, s, ds))
        after = _barrier(nc, s, ds, y, step, length)
        while not after + length * uphill <= value - 1e-4 * length * decrement:
            length *= 0.5
            if length < 1e-12:
                return
            after = _barrier(nc, s, ds, y, step, length)
        value = after
        for a in range(d):
            y[a] += length * step[a]
        for j in range(0, s.shape[0], LANES):
            write(read(s, j) + length * read(ds, j), s, j)


@inner
def _newton_system(nc, basis, push, y, s, bend, slope, step):
    """Write the second derivatives (lower half) into ``bend`` and the negative first derivatives into ``step``."""
    d = bend.shape[0]
    room = ROOM * ROOM
    for a in range(d):
        room -= y[a] * y[a]
    for a in range(d):
        step[a] = -push[a] - 2 * y[a] / room
        for b in range(0, a + 1, LANES):
            write(4 * y[a] * read(y, b) / (room * room), bend[a], b)
        bend[a, a] += 2 / room
    for i in range(nc):
        s0, s1, s2, g0, g1, g2 = s[3 * i], s[3 * i + 1], s[3 * i + 2], basis[i, 0], basis[i, 1], basis[i, 2]
        w = 2 / (s0 * s0 - s1 * s1 - s2 * s2)
        for b in range(0, d, LANES):
            slopes = w * (s0 * read(g0, b) - s1 * read(g1, b) - s2 * read(g2, b))
            write(slopes, slope, b)
            write(read(step, b) + slopes, step, b)
        for a in range(d):
            f, h0, h1, h2 = slope[a], w * g0[a], w * g1[a], w * g2[a]
            for b in range(0, a + 1, LANES):
                bends = f * read(slope, b) - h0 * read(g0, b) + h1 * read(g1, b) + h2 * read(g2, b)
                write(read(bend[a], b) + bends, bend[a], b)


@inner
def _solve(A, column, x):
    """Solve A x = x by Cholesky factorisation; only the lower half of A is read, A is overwritten. Return x . A^-1 x.

    ``column``, as long as a row of A, is workspace.
    """
    d, trace, square = A.shape[0], 0.0, 0.0
    for a in range(d):
        trace += A[a, a]
    for k in range(d):
        pivot = np.sqrt(max(A[k, k], ROUNDING * trace))
        A[k, k] = pivot
        x[k] /= pivot
        square += x[k] * x[k]
        column[k] = 0.0
        for a in range(k + 1, d):
            A[a, k] /= pivot
            column[a] = A[a, k]
            x[a] -= column[a] * x[k]
        for a in range(k + 1, d):
            f = column[a]
            for b in range((k + 1) // LANES * LANES, a + 1, LANES):
                write(read(A[a], b) - f * read(column, b), A[a], b)
    for a in range(d - 1, -1, -1):
        t = x[a]
        for k in range(a + 1, d):
            t -= A[k, a] * x[k]
        x[a] = t / A[a, a]
    return square


@inner
def _barrier(nc, s, ds, y, step, length):
    """Return the barrier at s + length ds; inf outside the cones."""
    room, value = ROOM * ROOM, 0.0
    for a in range(y.shape[0]):
        room -= (y[a] + length * step[a]) ** 2
    if not room > 0.0:
        return np.inf
    for i in range(0, 3 * nc, 3):
        s0, s1, s2 = s[i] + length * ds[i], s[i + 1] + length * ds[i + 1], s[i + 2] + length * ds[i + 2]
        det = s0 * s0 - s1 * s1 - s2 * s2
        if not (det > 0.0 and s0 > 0.0):
            return np.inf
        value -= np.log(det)
    return value - np.log(room)


@inner
def _reach(nc, s, ds):
    """Return the largest multiple of ``ds`` by which the forces can move until one reaches the boundary of its cone."""
    reach = np.inf
    for i in range(0, 3 * nc, 3):
        s0, s1, s2, d0, d1, d2 = s[i], s[i + 1], s[i + 2], ds[i], ds[i + 1], ds[i + 2]
        a, b, c = d0 * d0 - d1 * d1 - d2 * d2, s0 * d0 - s1 * d1 - s2 * d2, s0 * s0 - s1 * s1 - s2 * s2
        root = np.sqrt(max(b * b - a * c, 0.0)) - b  # the smallest positive root of c + 2 b x + a x^2 is c / root
        if root > 0.0:
            reach = min(reach, c / root)
    return reach
