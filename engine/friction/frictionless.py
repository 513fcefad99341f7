"""Impulses of a few frictionless contacts, from one equation for each closed contact.

0 <= r _|_ W r + q >= 0 with W = G G', G the normal rows: a guess which contacts are closed gives their impulses from a
small system, and these the next guess, as in Newton's method (Hintermueller, Ito, Kunisch 2003). For few contacts this
system is smaller than that of the bodies' velocities, which all other methods solve.
"""

import numpy as np

from engine.friction.arrays import CONVERGED, NOT_CONVERGED
from engine.friction.blocks import ROW, clear
from engine.jit import inner
from engine.jit.lanes import LANES, fused, read, spread, total, write

GUESSES = 12  # usually three are needed
MOST = 24  # contacts; long chains with play rattle more after exact solutions, which takes iterations
REDUNDANT = 1e-10  # share of a contact's own entry in W that the pivot of a redundant contact is set to


@inner
def fits(nc, p):
    """Return whether `solve_frictionless` takes this problem: few contacts, and no bilateral rows."""
    return nc <= MOST and p.bilateral.J.shape[0] == 0 and 2 * nc * _width(nc) <= p.K.shape[0]


@inner
def solve_frictionless(nc, p, tolerance):
    """Solve the normal equations of the first ``nc`` contacts from the impulses in ``p.r``; return the status.

    CONVERGED: ``p.w`` holds the velocities; no contact closes, and no closed one opens, faster than ``tolerance`` times
    the largest closing velocity in ``p.q``. NOT_CONVERGED: no guess was confirmed. Neither ``p.r`` nor the rows change,
    of which only the normals are read. The contacts are rigid. See `fits`.
    """
    c, W, rows, n = p.contacts, p.K, p.rows, _width(nc)
    closing = 0.0
    for i in range(n):
        c.r[0, i] = p.r[i, 0] if i < nc else 0.0
        c.q[0, i] = p.q[i, 0] if i < nc else 0.0
        closing = max(closing, -c.q[0, i])
    for i in range(nc):
        for j in range(0, n, LANES):
            write(spread(0.0), W, n * i + j)
        for j in range(i + 1):
            W[n * i + j] = W[n * j + i] = _product(rows, i, j)
    for i in range(nc):
        c.u[0, i] = c.q[0, i] + _dot(W, n * i, c.r[0], n)
    for i in range(nc):
        c.present[i] = 1.0 if W[(n + 1) * i] * c.r[0, i] - c.u[0, i] > 0.0 else 0.0
    for _ in range(GUESSES):
        _impulses_of_closed(nc, n, c, W)
        changed, off = False, 0.0
        for i in range(nc):
            c.u[0, i] = c.q[0, i] + _dot(W, n * i, c.r[0], n)
        for i in range(nc):
            guessed = c.present[i] > 0.0
            closed = c.r[0, i] > 0.0 if guessed else c.u[0, i] < -tolerance * closing
            off = max(off, abs(c.u[0, i])) if guessed else off
            changed = changed or closed != guessed
            c.present[i] = 1.0 if closed else 0.0
        if not changed:
            if not off <= tolerance * closing:  # redundant contacts that contradict each other
                return NOT_CONVERGED
            clear(p.w)
            for i in range(nc):
                _add_impulse(rows, i, c.r[0, i], p.w)
            return CONVERGED
    return NOT_CONVERGED


@inner
def _width(nc):
    """Return the length of a row of W, in whole groups of eight."""
    return -(-nc // LANES) * LANES


@inner
def _product(rows, i, j):
    """Return the entry of W for contacts i and j."""
    sums = spread(0.0)
    for s in range(rows.node.shape[1]):
        for t in range(rows.node.shape[1]):
            if rows.node[i, s] >= 0 and rows.node[i, s] == rows.node[j, t]:
                sums = fused(read(rows.G[i, 0], ROW * s), read(rows.G[j, 0], ROW * t), sums)
    return total(sums)


@inner
def _dot(W, at, x, n):
    """Return the scalar product of a row of W with a vector."""
    sums = spread(0.0)
    for j in range(0, n, LANES):
        sums = fused(read(W, at + j), read(x, j), sums)
    return total(sums)


@inner
def _impulses_of_closed(nc, n, c, W):
    """Write the impulses with which the closed contacts, marked in ``c.present``, rest; those of the others are 0."""
    r, factor = c.r[0], n * nc  # where the factor L of W = L L' begins; rows and columns of open contacts are 0
    for i in range(nc):
        row, sums = factor + n * i, 0.0
        for j in range(0, n, LANES):
            write(spread(0.0), W, row + j)
        r[i] = 0.0
        if c.present[i] == 0.0:
            continue
        for j in range(i):
            if c.present[j] > 0.0:
                W[row + j] = (W[n * i + j] - _dot_rows(W, row, factor + n * j, n)) / W[factor + (n + 1) * j]
        own = W[(n + 1) * i]
        for j in range(0, n, LANES):
            x = read(W, row + j)
            sums += total(x * x)
        r[i] = -c.q[0, i] - _dot(W, row, r, n)
        pivot = np.sqrt(max(own - sums, REDUNDANT * own))
        W[row + i] = pivot
        r[i] /= pivot
    for i in range(nc - 1, -1, -1):
        if c.present[i] > 0.0:
            row = factor + n * i
            impulse = r[i] / W[row + i]
            for j in range(0, n, LANES):
                write(fused(spread(-impulse), read(W, row + j), read(r, j)), r, j)
            r[i] = impulse


@inner
def _dot_rows(W, a, b, n):
    """Return the scalar product of two rows."""
    sums = spread(0.0)
    for j in range(0, n, LANES):
        sums = fused(read(W, a + j), read(W, b + j), sums)
    return total(sums)


@inner
def _add_impulse(rows, i, r, w):
    """Add the effect of a normal impulse to a vector of unknowns."""
    for s in range(rows.node.shape[1]):
        if rows.node[i, s] >= 0:
            at = ROW * rows.node[i, s]
            write(fused(spread(r), read(rows.G[i, 0], ROW * s), read(w, at)), w, at)
