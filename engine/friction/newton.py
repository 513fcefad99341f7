"""Newton's method on the smoothed Fischer-Burmeister equations: quick from a good start.

Every contact's equation is linearised and solved for its impulse (`block.eliminate`), which leaves one system in the
velocity w alone, (I + sum_i G_i' A_i G_i) dw = -sum_i G_i' b_i: as many unknowns as the mechanism has degrees of
freedom, however many contacts there are and however redundant they may be.

The smoothing tau starts at a fraction of |q| and falls as the equation is met, so that a wrong guess of which contacts
open, slide and stick is left early instead of being defended.
"""

import numpy as np

from engine.friction.arrays import (
    add_block,
    add_impulse,
    factorise,
    finish,
    relative,
    start_system,
    substitute,
    velocity_of,
)
from engine.friction.block import eliminate, eliminate_smooth_contact, phi, phi_smooth_contact
from engine.friction.cone import residual
from engine.kernels.jit import kernel

PROXIMAL = 1e-6


@kernel
def newton(n, nc, p, mean, tolerance, smoothing, limit):
    """Improve the impulses ``p.r``, at most ``limit`` steps; return the steps spent and the residual reached.

    Gives up early when the line search creeps: the caller has a better method for such problems.
    """
    size = 0.0
    for i in range(nc):
        for k in range(3):
            size += p.q[i, k] * p.q[i, k]
    size = np.sqrt(size / max(nc, 1))
    tau, creep = smoothing * size, 0
    finish(nc, p.rows, p.q, p.r, p.w, p.u)
    reached = residual(nc, p.mu, p.r, p.u, p.q, mean, True)
    iteration = 0
    while reached > tolerance and iteration < limit and creep < 3:
        iteration += 1
        merit = _direction(n, nc, p, tau * tau)
        step, after = _line_search(nc, p, tau * tau, merit)
        if not after < np.inf:
            break
        creep = creep + 1 if step < 0.1 else 0
        for i in range(nc):
            for k in range(3):
                p.r[i, k] += step * p.dx[i, k]
        finish(nc, p.rows, p.q, p.r, p.w, p.u)
        reached = residual(nc, p.mu, p.r, p.u, p.q, mean, True)
        if after <= 0.25 * tau * tau * nc:
            tau = max(0.1 * tau, 1e-12 * size)
    return iteration, reached if reached < np.inf else np.inf


@kernel
def _direction(n, nc, p, tau2):
    """Write Newton's direction: impulses into dx, relative velocities into dy; return the merit sum |phi|^2."""
    rhs = p.dw
    start_system(n, p.K)
    for k in range(n):
        rhs[k] = 0.0
    merit = 0.0
    for i in range(nc):
        s = p.scale[i]
        r0, r1, r2 = s * p.r[i, 0], s * p.r[i, 1], s * p.r[i, 2]
        if p.mu[i] > 0.0:
            merit += eliminate(p.mu[i], r0, r1, r2, p.u[i, 0], p.u[i, 1], p.u[i, 2], tau2, PROXIMAL, i, p.A, p.b)
        else:
            merit += eliminate_smooth_contact(r0, r1, r2, p.u[i, 0], tau2, PROXIMAL, i, p.A, p.b)
        for k in range(3):  # back to impulses
            for j in range(3):
                p.A[i, k, j] /= s
            p.b[i, k] /= s
        add_block(p.rows, i, p.A, p.AG, p.K)
        add_impulse(p.rows, i, -p.b[i, 0], -p.b[i, 1], -p.b[i, 2], rhs)
    factorise(n, p.K)
    substitute(n, p.K, rhs)
    for i in range(nc):
        d0, d1, d2 = relative(p.rows, i, rhs)
        for k in range(3):
            p.dx[i, k] = -p.b[i, k] - (p.A[i, k, 0] * d0 + p.A[i, k, 1] * d1 + p.A[i, k, 2] * d2)
    velocity_of(nc, p.rows, p.dx, p.dw)  # not the system's own solution: u must stay G G' r + q to the last digit
    for i in range(nc):
        p.dy[i, 0], p.dy[i, 1], p.dy[i, 2] = relative(p.rows, i, p.dw)
    return merit


@kernel
def _line_search(nc, p, tau2, merit):
    """Halve the step until the merit falls; return the step and the merit there."""
    step, after = 1.0, np.inf
    for _ in range(12):
        after = 0.0
        for i in range(nc):
            s = p.scale[i]
            r0, u0 = s * (p.r[i, 0] + step * p.dx[i, 0]), p.u[i, 0] + step * p.dy[i, 0]
            if p.mu[i] > 0.0:
                r1, r2 = s * (p.r[i, 1] + step * p.dx[i, 1]), s * (p.r[i, 2] + step * p.dx[i, 2])
                u1, u2 = p.u[i, 1] + step * p.dy[i, 1], p.u[i, 2] + step * p.dy[i, 2]
                f0, f1, f2 = phi(p.mu[i], r0, r1, r2, u0, u1, u2, tau2)
                after += f0 * f0 + f1 * f1 + f2 * f2
            else:
                f0 = phi_smooth_contact(r0, u0, tau2)
                after += f0 * f0
        if after <= (1 - 1e-2 * step) * merit:
            break
        step *= 0.5
    return step, after
