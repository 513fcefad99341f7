"""A friction problem as arrays, with the operations every solver shares.

The problem, whitened (M = I):  w = G' r,  u = G w + q,  Coulomb's law between each r_i and u_i.

Kernels get the arrays they need and not the whole tuple: every array of a call costs compile time.
"""

from typing import NamedTuple

import numpy as np

from engine.friction.ties import Ties
from engine.kernels.jit import kernel

BODY = 6  # velocities of a body

CONVERGED = 0
NOT_CONVERGED = 1


class Rows(NamedTuple):
    """The rows of G. Contact i touches runs of velocities, one for each body: ``start[i, s]`` ... + ``width[i, s]``.

    ``G[i]`` holds the columns of its runs one after the other.
    """

    start: np.ndarray  # (nc, ns) int64
    width: np.ndarray  # (nc, ns) int64, 0: no such run
    G: np.ndarray  # (nc, 3, k) rows (N, T1, T2)
    band: np.ndarray  # (1,) int64, the farthest two velocities of one contact


class FrictionArrays(NamedTuple):
    """A whitened friction problem of at most ``nc`` contacts and ``n`` velocities, its unknowns and work space."""

    rows: Rows
    ties: Ties
    q: np.ndarray  # (nc, 3) relative velocity without impulses, plus the law's shift
    mu: np.ndarray  # (nc,)
    r: np.ndarray  # (nc, 3) impulses: start on entry, solution on return
    u: np.ndarray  # (nc, 3) relative velocities of the solution
    w: np.ndarray  # (n,) velocity change of the solution
    scale: np.ndarray  # (nc,) mean diagonal of the contact's own Delassus block
    x: np.ndarray  # (nc, 3) scaled impulses
    y: np.ndarray  # (nc, 3) scaled shifted velocities
    dx: np.ndarray  # (nc, 3)
    dy: np.ndarray  # (nc, 3)
    miss: np.ndarray  # (nc, 3) residual of the definition of y
    A: np.ndarray  # (nc, 3, 3) eliminated block: dx = -b - A dy
    W: np.ndarray  # (nc, 3, 3) scaling
    b: np.ndarray  # (nc, 3)
    AG: np.ndarray  # (3, k)
    K: np.ndarray  # (n, n)
    dw: np.ndarray  # (n,)
    lag: np.ndarray  # (n,) residual of w = G' r
    kept: np.ndarray  # (nc, 3) impulses of the best attempt
    best: np.ndarray  # (nc, 3) impulses of the smallest residual within an attempt
    q0: np.ndarray  # (nc,) normal part of q while q holds a given shift
    shift: np.ndarray  # (nc,) that shift


def friction_arrays(n: int, nc: int, runs: int, k: int, band: int, ties: int = 0) -> FrictionArrays:
    """Allocate ``nc`` contacts on ``n`` velocities, each touching at most ``k`` of them in at most ``runs`` runs."""
    shapes = {
        "mu": (nc,), "scale": (nc,), "q0": (nc,), "shift": (nc,), "A": (nc, 3, 3), "W": (nc, 3, 3), "AG": (3, k),
        "w": (n,), "dw": (n,), "lag": (n,), "K": (n, n),
    }  # fmt: skip
    start, width = np.zeros((2, nc, runs), np.int64)
    rows = Rows(start, width, np.zeros((nc, 3, k)), np.array([band], np.int64))
    return FrictionArrays(
        rows,
        Ties(
            np.zeros(ties, np.int64), np.zeros((ties, 2), np.int64), np.zeros((ties, 2), np.int64), np.zeros((ties, 12))
        ),
        *(np.zeros(shapes.get(name, (nc, 3))) for name in FrictionArrays._fields[2:]),
    )


@kernel
def copy(nc, source, target):
    """Copy the first ``nc`` rows of three."""
    for i in range(nc):
        target[i, 0], target[i, 1], target[i, 2] = source[i, 0], source[i, 1], source[i, 2]


@kernel
def measure_scales(nc, rows, scale):
    """Write each contact's mean Delassus diagonal; return their mean."""
    mean = 0.0
    for i in range(nc):
        s, width = 0.0, 0
        for run in range(rows.width.shape[1]):
            width += rows.width[i, run]
        for k in range(3):
            for a in range(width):
                s += rows.G[i, k, a] * rows.G[i, k, a]
        mean += s
        scale[i] = s / 3 if s > 0.0 else 1.0
    mean /= max(3 * nc, 1)
    return mean if mean > 0.0 else 1.0


@kernel
def velocity_of(nc, rows, r, w):
    """Write w = G' r."""
    for k in range(w.shape[0]):
        w[k] = 0.0
    for i in range(nc):
        add_impulse(rows, i, r[i, 0], r[i, 1], r[i, 2], w)


@kernel
def add_impulse(rows, i, r0, r1, r2, w):
    """Add G_i' r to a vector of velocities."""
    a = 0
    for run in range(rows.width.shape[1]):
        first, width = rows.start[i, run], rows.width[i, run]
        for k in range(width):
            w[first + k] += rows.G[i, 0, a + k] * r0 + rows.G[i, 1, a + k] * r1 + rows.G[i, 2, a + k] * r2
        a += width


@kernel
def relative(rows, i, w):
    """Return the three components of G_i w."""
    u0, u1, u2, a = 0.0, 0.0, 0.0, 0
    for run in range(rows.width.shape[1]):
        first, width = rows.start[i, run], rows.width[i, run]
        for k in range(width):
            y = w[first + k]
            u0 += rows.G[i, 0, a + k] * y
            u1 += rows.G[i, 1, a + k] * y
            u2 += rows.G[i, 2, a + k] * y
        a += width
    return u0, u1, u2


@kernel
def finish(nc, rows, q, r, w, u):
    """Write the velocities w and u that belong to the impulses r."""
    velocity_of(nc, rows, r, w)
    for i in range(nc):
        u0, u1, u2 = relative(rows, i, w)
        u[i, 0], u[i, 1], u[i, 2] = q[i, 0] + u0, q[i, 1] + u1, q[i, 2] + u2


@kernel
def start_system(n, band, K):
    """Write the identity, the whitened mass matrix, inside the band."""
    for i in range(n):
        for j in range(max(i - band, 0), min(i + band + 1, n)):
            K[i, j] = 0.0
        K[i, i] = 1.0


@kernel
def add_block(rows, i, A, AG, K):
    """Add G_i' A G_i to the system, for the 3 x 3 block A of contact i.

    Runs of a body are of known size, which the compiler turns into straight vector code: a third of the time.
    """
    G, runs, a = rows.G, rows.width.shape[1], 0
    a00, a01, a02 = A[i, 0, 0], A[i, 0, 1], A[i, 0, 2]
    a10, a11, a12 = A[i, 1, 0], A[i, 1, 1], A[i, 1, 2]
    a20, a21, a22 = A[i, 2, 0], A[i, 2, 1], A[i, 2, 2]
    for run in range(runs):
        for j in range(a, a + rows.width[i, run]):
            g0, g1, g2 = G[i, 0, j], G[i, 1, j], G[i, 2, j]
            AG[0, j] = a00 * g0 + a01 * g1 + a02 * g2
            AG[1, j] = a10 * g0 + a11 * g1 + a12 * g2
            AG[2, j] = a20 * g0 + a21 * g1 + a22 * g2
        a += rows.width[i, run]
    a = 0
    for run in range(runs):
        row, m, c = rows.start[i, run], rows.width[i, run], 0
        for other in range(runs):
            column, n = rows.start[i, other], rows.width[i, other]
            if m == BODY and n == BODY:
                for j in range(BODY):
                    g0, g1, g2 = G[i, 0, a + j], G[i, 1, a + j], G[i, 2, a + j]
                    for k in range(BODY):
                        K[row + j, column + k] += g0 * AG[0, c + k] + g1 * AG[1, c + k] + g2 * AG[2, c + k]
            else:
                for j in range(m):
                    g0, g1, g2 = G[i, 0, a + j], G[i, 1, a + j], G[i, 2, a + j]
                    for k in range(n):
                        K[row + j, column + k] += g0 * AG[0, c + k] + g1 * AG[1, c + k] + g2 * AG[2, c + k]
            c += n
        a += m


@kernel
def factorise(n, band, K):
    """Replace K by its factors L U inside the band; no pivoting, the symmetric part is positive definite."""
    for k in range(n):
        pivot, last = 1 / K[k, k], min(k + band + 1, n)
        for i in range(k + 1, last):
            if K[i, k] != 0.0:
                f = K[i, k] * pivot
                K[i, k] = f
                for j in range(k + 1, last):
                    K[i, j] -= f * K[k, j]


@kernel
def substitute(n, band, K, x):
    """Solve L U x = x in place."""
    for i in range(n):
        s = x[i]
        for j in range(max(i - band, 0), i):
            s -= K[i, j] * x[j]
        x[i] = s
    for i in range(n - 1, -1, -1):
        s = x[i]
        for j in range(i + 1, min(i + band + 1, n)):
            s -= K[i, j] * x[j]
        x[i] = s / K[i, i]
