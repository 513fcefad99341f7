"""A friction problem as arrays, with the operations every solver shares.

The problem, whitened (M = I):  w = G' r,  u = G w + q,  Coulomb's law between each r_i and u_i.
"""

from typing import NamedTuple

import numpy as np

from engine.kernels.jit import kernel

CONVERGED = 0
NOT_CONVERGED = 1


class FrictionArrays(NamedTuple):
    """A whitened friction problem of at most ``nc`` contacts and ``n`` velocities, its unknowns and work space.

    Contact i touches the ``count[i]`` velocities ``column[i, :count[i]]``; its rows (N, T1, T2) of G are ``G[i]``.
    """

    column: np.ndarray  # (nc, k) int64
    count: np.ndarray  # (nc,) int64
    G: np.ndarray  # (nc, 3, k)
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
    factor: np.ndarray  # (n, n)
    dw: np.ndarray  # (n,)
    lag: np.ndarray  # (n,) residual of w = G' r
    start: np.ndarray  # (nc, 3) impulses on entry
    best: np.ndarray  # (nc, 3) impulses of the smallest residual seen
    q0: np.ndarray  # (nc,) normal part of q while q holds a given shift


def friction_arrays(n: int, nc: int, k: int) -> FrictionArrays:
    """Allocate a problem of ``nc`` contacts on ``n`` velocities, at most ``k`` of them per contact."""
    shapes = {
        "column": (nc, k), "count": (nc,), "G": (nc, 3, k), "mu": (nc,), "scale": (nc,), "q0": (nc,), "A": (nc, 3, 3),
        "W": (nc, 3, 3), "AG": (3, k), "w": (n,), "dw": (n,), "lag": (n,), "K": (n, n), "factor": (n, n),
    }  # fmt: skip
    integers = {"column", "count"}
    return FrictionArrays(
        *(
            np.zeros(shapes.get(name, (nc, 3)), np.int64 if name in integers else np.float64)
            for name in FrictionArrays._fields
        )
    )


@kernel
def measure_scales(nc, p):
    """Write each contact's mean Delassus diagonal; return their mean."""
    mean = 0.0
    for i in range(nc):
        s = 0.0
        for k in range(3):
            for a in range(p.count[i]):
                s += p.G[i, k, a] * p.G[i, k, a]
        mean += s
        p.scale[i] = s / 3 if s > 0.0 else 1.0
    mean /= max(3 * nc, 1)
    return mean if mean > 0.0 else 1.0


@kernel
def velocity_of(nc, p, r, w):
    """Write w = G' r."""
    w[:] = 0.0
    for i in range(nc):
        r0, r1, r2 = r[i, 0], r[i, 1], r[i, 2]
        for a in range(p.count[i]):
            w[p.column[i, a]] += p.G[i, 0, a] * r0 + p.G[i, 1, a] * r1 + p.G[i, 2, a] * r2


@kernel
def relative(p, i, w):
    """Return the three components of G_i w."""
    u0, u1, u2 = 0.0, 0.0, 0.0
    for a in range(p.count[i]):
        y = w[p.column[i, a]]
        u0 += p.G[i, 0, a] * y
        u1 += p.G[i, 1, a] * y
        u2 += p.G[i, 2, a] * y
    return u0, u1, u2


@kernel
def finish(nc, p):
    """Write the velocities w and u that belong to the impulses r."""
    velocity_of(nc, p, p.r, p.w)
    for i in range(nc):
        u0, u1, u2 = relative(p, i, p.w)
        p.u[i, 0], p.u[i, 1], p.u[i, 2] = p.q[i, 0] + u0, p.q[i, 1] + u1, p.q[i, 2] + u2


@kernel
def start_system(n, K):
    """Write the identity: the whitened mass matrix."""
    for i in range(n):
        for j in range(n):
            K[i, j] = 0.0
        K[i, i] = 1.0


@kernel
def add_block(p, i, A, K):
    """Add G_i' A G_i to the system, for a 3 x 3 block A."""
    G, m = p.G[i], p.count[i]
    for a in range(m):
        for k in range(3):
            p.AG[k, a] = A[k, 0] * G[0, a] + A[k, 1] * G[1, a] + A[k, 2] * G[2, a]
    for a in range(m):
        g0, g1, g2, row = G[0, a], G[1, a], G[2, a], p.column[i, a]
        for c in range(m):
            K[row, p.column[i, c]] += g0 * p.AG[0, c] + g1 * p.AG[1, c] + g2 * p.AG[2, c]


@kernel
def add_impulse(p, i, r0, r1, r2, rhs):
    """Add G_i' r to the right-hand side."""
    for a in range(p.count[i]):
        rhs[p.column[i, a]] += p.G[i, 0, a] * r0 + p.G[i, 1, a] * r1 + p.G[i, 2, a] * r2


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
