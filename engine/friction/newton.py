"""Newton's method on the smoothed friction problem: the primary solver, and with other settings its own fallback.

The problem, whitened (M = I):  w = G' r,  u = G w + q,  Coulomb's law between each r_i and u_i.

Every contact's equation is linearised and solved for its impulse (`block.eliminate`), which leaves one system in the
velocity w alone, (I + sum_i G_i' A_i G_i) dw = -sum_i G_i' b_i: as many unknowns as the mechanism has degrees of
freedom, however many contacts there are and however redundant they may be.

The smoothing tau starts at a fraction of |q| and falls as the equation is met, so that a wrong guess of which contacts
open, slide and stick is left early instead of being defended (continuation of Chen, Fukushima and others).
"""

from typing import NamedTuple

import numpy as np

from engine.friction.block import eliminate, eliminate_smooth_contact, phi, phi_smooth_contact
from engine.friction.cone import residual
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
    dx: np.ndarray  # (nc, 3)
    du: np.ndarray  # (nc, 3)
    A: np.ndarray  # (nc, 3, 3)
    b: np.ndarray  # (nc, 3)
    AG: np.ndarray  # (3, k)
    K: np.ndarray  # (n, n)
    dw: np.ndarray  # (n,)
    start: np.ndarray  # (nc, 3) impulses on entry
    best: np.ndarray  # (nc, 3) impulses of the smallest residual seen


def friction_arrays(n: int, nc: int, k: int) -> FrictionArrays:
    """Allocate a problem of ``nc`` contacts on ``n`` velocities, at most ``k`` of them per contact."""
    f = np.zeros
    return FrictionArrays(
        column=f((nc, k), np.int64), count=f(nc, np.int64), G=f((nc, 3, k)), q=f((nc, 3)), mu=f(nc), r=f((nc, 3)),
        u=f((nc, 3)), w=f(n), scale=f(nc), x=f((nc, 3)), dx=f((nc, 3)), du=f((nc, 3)), A=f((nc, 3, 3)), b=f((nc, 3)),
        AG=f((3, k)), K=f((n, n)), dw=f(n), start=f((nc, 3)), best=f((nc, 3)),
    )  # fmt: skip


@kernel
def solve_friction(n, nc, p, tolerance):
    """Solve the first ``nc`` contacts of the problem ``p`` from the impulses in ``p.r``.

    Tries, until one attempt reaches ``tolerance``: from the given start, then from zero with more and more smoothing.
    If none does, the impulses of the smallest residual are left in ``p.r``.

    Returns
    -------
    status : CONVERGED or NOT_CONVERGED
    iterations : Newton steps of all attempts
    reached : relative residual (see `cone.residual`)
    """
    mean = _scales(nc, p)
    warm = False
    for i in range(nc):
        for k in range(3):
            p.start[i, k] = p.r[i, k]
            p.best[i, k] = p.r[i, k]
            warm = warm or p.r[i, k] != 0.0
    total, best = 0, np.inf
    for attempt in range(6):
        if attempt == 0 and warm:
            smoothing, proximal, limit = 1e-5, 1e-6, 25
        elif attempt <= 1:
            smoothing, proximal, limit = 1e-2, 1e-6, 60
        elif attempt == 2:
            smoothing, proximal, limit = 1.0, 1e-7, 120
        elif attempt == 3:
            smoothing, proximal, limit = 1.0, 1e-5, 200
        elif attempt == 4:
            smoothing, proximal, limit = 10.0, 1e-8, 300
        else:
            smoothing, proximal, limit = 0.1, 1e-4, 300
        if attempt == 1 and not warm:
            continue
        if attempt > 0:
            p.r[:nc] = 0.0
        iterations, reached = _newton(n, nc, p, mean, tolerance, smoothing, proximal, limit)
        total += iterations
        if reached < best:
            best = reached
            p.best[:nc] = p.r[:nc]
        if reached <= tolerance:
            return CONVERGED, total, reached
    for i in range(nc):
        for k in range(3):
            p.r[i, k] = p.best[i, k]
            p.x[i, k] = p.r[i, k] * p.scale[i]
    _velocity(nc, p, p.x, p.w)
    _relative_velocity(nc, p, p.w, p.q, p.u)
    return NOT_CONVERGED, total, best


@kernel
def _newton(n, nc, p, mean, tolerance, smoothing, proximal, limit):
    """One attempt; returns the iterations spent and the residual reached."""
    size = 0.0
    for i in range(nc):
        for k in range(3):
            p.x[i, k] = p.r[i, k] * p.scale[i]
            size += p.q[i, k] * p.q[i, k]
    size = np.sqrt(size / max(nc, 1))
    tau = smoothing * size
    _velocity(nc, p, p.x, p.w)
    _relative_velocity(nc, p, p.w, p.q, p.u)
    for iteration in range(limit + 1):
        for i in range(nc):
            for k in range(3):
                p.r[i, k] = p.x[i, k] / p.scale[i]
        reached = residual(nc, p.mu, p.r, p.u, p.q, mean)
        if not reached > tolerance or iteration == limit:
            break
        merit = _direction(n, nc, p, tau * tau, proximal)
        step, after = _line_search(nc, p, tau * tau, merit)
        if not after < np.inf:
            break
        for i in range(nc):
            for k in range(3):
                p.x[i, k] += step * p.dx[i, k]
        _velocity(nc, p, p.x, p.w)
        _relative_velocity(nc, p, p.w, p.q, p.u)
        if after <= 0.25 * tau * tau * nc:
            tau = max(0.1 * tau, 1e-12 * size)
    if np.isnan(reached):
        reached = np.inf
    return iteration, reached


@kernel
def _scales(nc, p):
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
def _velocity(nc, p, x, w):
    """Write w = G' r for the scaled impulses x."""
    w[:] = 0.0
    for i in range(nc):
        x0, x1, x2 = x[i, 0] / p.scale[i], x[i, 1] / p.scale[i], x[i, 2] / p.scale[i]
        for a in range(p.count[i]):
            w[p.column[i, a]] += p.G[i, 0, a] * x0 + p.G[i, 1, a] * x1 + p.G[i, 2, a] * x2


@kernel
def _relative_velocity(nc, p, w, q, u):
    """Write u = G w + q."""
    for i in range(nc):
        u0, u1, u2 = q[i, 0], q[i, 1], q[i, 2]
        for a in range(p.count[i]):
            y = w[p.column[i, a]]
            u0 += p.G[i, 0, a] * y
            u1 += p.G[i, 1, a] * y
            u2 += p.G[i, 2, a] * y
        u[i, 0], u[i, 1], u[i, 2] = u0, u1, u2


@kernel
def _direction(n, nc, p, tau2, proximal):
    """Write Newton's direction into dx, du; return the merit sum |phi|^2 at the present point."""
    K, rhs = p.K, p.dw
    for i in range(n):
        for j in range(n):
            K[i, j] = 0.0
        K[i, i] = 1.0
        rhs[i] = 0.0
    merit = 0.0
    for i in range(nc):
        A, b, G = p.A[i], p.b[i], p.G[i]
        if p.mu[i] > 0.0:
            merit += eliminate(
                p.mu[i], p.x[i, 0], p.x[i, 1], p.x[i, 2], p.u[i, 0], p.u[i, 1], p.u[i, 2], tau2, proximal, A, b
            )  # fmt: skip
        else:
            merit += eliminate_smooth_contact(p.x[i, 0], p.x[i, 1], p.x[i, 2], p.u[i, 0], tau2, proximal, A, b)
        s, m = 1 / p.scale[i], p.count[i]
        for a in range(m):
            for k in range(3):
                p.AG[k, a] = s * (A[k, 0] * G[0, a] + A[k, 1] * G[1, a] + A[k, 2] * G[2, a])
        for a in range(m):
            g0, g1, g2, row = G[0, a], G[1, a], G[2, a], p.column[i, a]
            rhs[row] -= s * (g0 * b[0] + g1 * b[1] + g2 * b[2])
            for c in range(m):
                K[row, p.column[i, c]] += g0 * p.AG[0, c] + g1 * p.AG[1, c] + g2 * p.AG[2, c]
    _solve_dense(n, K, rhs)
    for i in range(nc):
        A, b = p.A[i], p.b[i]
        d0, d1, d2 = 0.0, 0.0, 0.0
        for a in range(p.count[i]):
            y = rhs[p.column[i, a]]
            d0 += p.G[i, 0, a] * y
            d1 += p.G[i, 1, a] * y
            d2 += p.G[i, 2, a] * y
        for k in range(3):
            p.dx[i, k] = -b[k] - (A[k, 0] * d0 + A[k, 1] * d1 + A[k, 2] * d2)
    _velocity(nc, p, p.dx, p.dw)  # not the solution itself: u must stay G w + q to the last digit
    for i in range(nc):
        d0, d1, d2 = 0.0, 0.0, 0.0
        for a in range(p.count[i]):
            y = p.dw[p.column[i, a]]
            d0 += p.G[i, 0, a] * y
            d1 += p.G[i, 1, a] * y
            d2 += p.G[i, 2, a] * y
        p.du[i, 0], p.du[i, 1], p.du[i, 2] = d0, d1, d2
    return merit


@kernel
def _line_search(nc, p, tau2, merit):
    """Halve the step until the merit falls; return the step and the merit there."""
    step, after = 1.0, np.inf
    for _ in range(20):
        after = 0.0
        for i in range(nc):
            r0, u0 = p.x[i, 0] + step * p.dx[i, 0], p.u[i, 0] + step * p.du[i, 0]
            if p.mu[i] > 0.0:
                f0, f1, f2 = phi(
                    p.mu[i], r0, p.x[i, 1] + step * p.dx[i, 1], p.x[i, 2] + step * p.dx[i, 2],
                    u0, p.u[i, 1] + step * p.du[i, 1], p.u[i, 2] + step * p.du[i, 2], tau2,
                )  # fmt: skip
                after += f0 * f0 + f1 * f1 + f2 * f2
            else:
                f0 = phi_smooth_contact(r0, u0, tau2)
                after += f0 * f0
        if after <= (1 - 1e-2 * step) * merit:
            break
        step *= 0.5
    return step, after


@kernel
def _solve_dense(n, K, x):
    """Solve K x = x in place by elimination, stepping over zeros; K is destroyed."""
    for k in range(n):
        pivot = 1 / K[k, k]
        for i in range(k + 1, n):
            if K[i, k] != 0.0:
                f = K[i, k] * pivot
                for j in range(k + 1, n):
                    K[i, j] -= f * K[k, j]
                x[i] -= f * x[k]
    for k in range(n - 1, -1, -1):
        s = x[k]
        for j in range(k + 1, n):
            s -= K[k, j] * x[j]
        x[k] = s / K[k, k]
