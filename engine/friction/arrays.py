"""A friction problem as arrays, with the operations every solver shares.

The problem, whitened (M = I):  w = G' r,  u = G w + q,  Coulomb's law between each r_i and u_i.

Kernels get the arrays they need and not the whole tuple: every array of a call costs compile time.
"""

from typing import NamedTuple

import numpy as np

from engine.kernels.jit import kernel

CONVERGED = 0
NOT_CONVERGED = 1


class Rows(NamedTuple):
    """The rows of G: contact i touches the ``count[i]`` velocities ``column[i, :count[i]]``."""

    column: np.ndarray  # (nc, k) int64
    count: np.ndarray  # (nc,) int64
    G: np.ndarray  # (nc, 3, k) rows (N, T1, T2)


class FrictionArrays(NamedTuple):
    """A whitened friction problem of at most ``nc`` contacts and ``n`` velocities, its unknowns and work space."""

    rows: Rows
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


def friction_arrays(n: int, nc: int, k: int) -> FrictionArrays:
    """Allocate a problem of ``nc`` contacts on ``n`` velocities, at most ``k`` of them per contact."""
    shapes = {
        "mu": (nc,), "scale": (nc,), "q0": (nc,), "shift": (nc,), "A": (nc, 3, 3), "W": (nc, 3, 3), "AG": (3, k),
        "w": (n,), "dw": (n,), "lag": (n,), "K": (n, n),
    }  # fmt: skip
    rows = Rows(np.zeros((nc, k), np.int64), np.zeros(nc, np.int64), np.zeros((nc, 3, k)))
    return FrictionArrays(rows, *(np.zeros(shapes.get(name, (nc, 3))) for name in FrictionArrays._fields[1:]))


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
        s = 0.0
        for k in range(3):
            for a in range(rows.count[i]):
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
    for a in range(rows.count[i]):
        w[rows.column[i, a]] += rows.G[i, 0, a] * r0 + rows.G[i, 1, a] * r1 + rows.G[i, 2, a] * r2


@kernel
def relative(rows, i, w):
    """Return the three components of G_i w."""
    u0, u1, u2 = 0.0, 0.0, 0.0
    for a in range(rows.count[i]):
        y = w[rows.column[i, a]]
        u0 += rows.G[i, 0, a] * y
        u1 += rows.G[i, 1, a] * y
        u2 += rows.G[i, 2, a] * y
    return u0, u1, u2


@kernel
def finish(nc, rows, q, r, w, u):
    """Write the velocities w and u that belong to the impulses r."""
    velocity_of(nc, rows, r, w)
    for i in range(nc):
        u0, u1, u2 = relative(rows, i, w)
        u[i, 0], u[i, 1], u[i, 2] = q[i, 0] + u0, q[i, 1] + u1, q[i, 2] + u2


@kernel
def start_system(n, K):
    """Write the identity: the whitened mass matrix."""
    for i in range(n):
        for j in range(n):
            K[i, j] = 0.0
        K[i, i] = 1.0


@kernel
def add_block(rows, i, A, AG, K):
    """Add G_i' A G_i to the system, for the 3 x 3 block A of contact i."""
    m = rows.count[i]
    for a in range(m):
        g0, g1, g2 = rows.G[i, 0, a], rows.G[i, 1, a], rows.G[i, 2, a]
        for k in range(3):
            AG[k, a] = A[i, k, 0] * g0 + A[i, k, 1] * g1 + A[i, k, 2] * g2
    for a in range(m):
        g0, g1, g2, row = rows.G[i, 0, a], rows.G[i, 1, a], rows.G[i, 2, a], rows.column[i, a]
        for c in range(m):
            K[row, rows.column[i, c]] += g0 * AG[0, c] + g1 * AG[1, c] + g2 * AG[2, c]


@kernel
def factorise(n, K):
    """Replace K by its factors L U, stepping over zeros; no pivoting, the symmetric part is positive definite."""
    for k in range(n):
        pivot = 1 / K[k, k]
        for i in range(k + 1, n):
            if K[i, k] != 0.0:
                f = K[i, k] * pivot
                K[i, k] = f
                for j in range(k + 1, n):
                    K[i, j] -= f * K[k, j]


@kernel
def substitute(n, K, x):
    """Solve L U x = x in place."""
    for i in range(n):
        s = x[i]
        for j in range(i):
            s -= K[i, j] * x[j]
        x[i] = s
    for i in range(n - 1, -1, -1):
        s = x[i]
        for j in range(i + 1, n):
            s -= K[i, j] * x[j]
        x[i] = s / K[i, i]
