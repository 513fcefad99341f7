"""Semismooth Newton on the natural map: one or two steps from the impulses of the step before.

Coulomb's law (eq. 5) holds when r = P_K(r - (u + mu |u_T| N)), with r scaled to a velocity and P_K the projection on
the cone. Every contact's equation is linearised and solved for its impulse, which leaves one system in the velocity w
alone, (I + sum_i G_i' A_i G_i) dw = -sum_i G_i' b_i: as many unknowns as the mechanism has degrees of freedom, however
many contacts there are and however redundant they may be.
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
from engine.friction.cone import project, residual
from engine.kernels.jit import kernel

PROXIMAL = 1e-5
HALVINGS = 6
CREEPING = 3  # short steps in a row: give up, the caller has a surer method
TINY = 1e-300


@kernel
def newton(n, nc, p, mean, tolerance, limit):
    """Improve the impulses ``p.r``, at most ``limit`` steps; return the steps spent and the residual reached.

    The line search is not monotone: a step may raise the merit above the present one, not above the last four.
    """
    finish(nc, p.rows, p.q, p.r, p.w, p.u)
    reached = residual(nc, p.mu, p.r, p.u, p.q, mean, True)
    iteration, creep, m1, m2, m3 = 0, 0, 0.0, 0.0, 0.0
    while reached > tolerance and iteration < limit and creep < CREEPING:
        iteration += 1
        merit = _direction(n, nc, p)
        step = _line_search(nc, p, max(merit, m1, m2, m3))
        m1, m2, m3 = merit, m1, m2
        creep = creep + 1 if step < 0.1 else 0
        for i in range(nc):
            for k in range(3):
                p.r[i, k] += step * p.dx[i, k]
        finish(nc, p.rows, p.q, p.r, p.w, p.u)
        reached = residual(nc, p.mu, p.r, p.u, p.q, mean, True)
    return iteration, reached if reached < np.inf else np.inf


@kernel
def _direction(n, nc, p):
    """Write Newton's direction: impulses into dx, relative velocities into dy; return the merit, the sum of squares."""
    rhs = p.dw
    start_system(n, p.rows.band[0], p.K)
    for k in range(n):
        rhs[k] = 0.0
    merit = 0.0
    for i in range(nc):
        merit += _eliminate(i, p.mu[i], p.scale[i], p.r, p.u, p.A, p.b)
        add_block(p.rows, i, p.A, p.AG, p.K)
        add_impulse(p.rows, i, -p.b[i, 0], -p.b[i, 1], -p.b[i, 2], rhs)
    factorise(n, p.rows.band[0], p.K)
    substitute(n, p.rows.band[0], p.K, rhs)
    for i in range(nc):
        d0, d1, d2 = relative(p.rows, i, rhs)
        for k in range(3):
            p.dx[i, k] = -p.b[i, k] - (p.A[i, k, 0] * d0 + p.A[i, k, 1] * d1 + p.A[i, k, 2] * d2)
    velocity_of(nc, p.rows, p.dx, p.dw)  # not the system's own solution: u must stay G G' r + q to the last digit
    for i in range(nc):
        p.dy[i, 0], p.dy[i, 1], p.dy[i, 2] = relative(p.rows, i, p.dw)
    return merit


@kernel
def _eliminate(i, mu, s, r, u, A, b):
    """Linearise f = s r - P_K(s r - u - mu |u_T| N) and solve it for the impulse: dr = -b - A du; return |f|^2.

    With D the derivative of the projection and E that of the shifted velocity, f' = (I - D) s dr + D E du. A proximal
    step on r, I - D + PROXIMAL D E in the place of I - D, serves the contacts that stick: there D = I, and the
    impulse is whatever the velocity asks for.
    """
    u0, u1, u2 = u[i, 0], u[i, 1], u[i, 2]
    x0, x1, x2 = s * r[i, 0], s * r[i, 1], s * r[i, 2]
    slip = np.sqrt(u1 * u1 + u2 * u2)
    p0, p1, p2 = x0 - u0 - mu * slip, x1 - u1, x2 - u2
    t = np.sqrt(p1 * p1 + p2 * p2)
    d00, d01, d02, d11, d12, d22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    f0, f1, f2 = x0, x1, x2
    if t <= mu * p0:  # inside the cone: sticking
        d00, d11, d22 = 1.0, 1.0, 1.0
        f0, f1, f2 = x0 - p0, x1 - p1, x2 - p2
    elif mu * t > -p0:  # beside it: sliding; else inside the polar cone: open
        k = 1 / (1 + mu * mu)
        n = k * (p0 + mu * t)
        e1, e2 = p1 / max(t, TINY), p2 / max(t, TINY)
        c = mu * n / max(t, TINY)
        f0, f1, f2 = x0 - n, x1 - mu * n * e1, x2 - mu * n * e2
        d00, d01, d02 = k, k * mu * e1, k * mu * e2
        d11, d12 = mu * e1 * d01 + c * (1 - e1 * e1), mu * e1 * d02 - c * e1 * e2
        d22 = mu * e2 * d02 + c * (1 - e2 * e2)
    t1, t2 = mu * u1 / max(slip, TINY), mu * u2 / max(slip, TINY)
    q01, q02 = d01 + d00 * t1, d02 + d00 * t2  # Q = D E
    q11, q12 = d11 + d01 * t1, d12 + d01 * t2
    q21, q22 = d12 + d02 * t1, d22 + d02 * t2
    m00, m01, m02 = 1 - d00 + PROXIMAL * d00, -d01 + PROXIMAL * q01, -d02 + PROXIMAL * q02
    m10, m11, m12 = -d01 + PROXIMAL * d01, 1 - d11 + PROXIMAL * q11, -d12 + PROXIMAL * q12
    m20, m21, m22 = -d02 + PROXIMAL * d02, -d12 + PROXIMAL * q21, 1 - d22 + PROXIMAL * q22
    c00, c01, c02 = m11 * m22 - m12 * m21, m02 * m21 - m01 * m22, m01 * m12 - m02 * m11
    c10, c11, c12 = m12 * m20 - m10 * m22, m00 * m22 - m02 * m20, m02 * m10 - m00 * m12
    c20, c21, c22 = m10 * m21 - m11 * m20, m01 * m20 - m00 * m21, m00 * m11 - m01 * m10
    d = 1 / (s * (m00 * c00 + m01 * c10 + m02 * c20))
    A[i, 0, 0] = d * (c00 * d00 + c01 * d01 + c02 * d02)
    A[i, 0, 1] = d * (c00 * q01 + c01 * q11 + c02 * q21)
    A[i, 0, 2] = d * (c00 * q02 + c01 * q12 + c02 * q22)
    A[i, 1, 0] = d * (c10 * d00 + c11 * d01 + c12 * d02)
    A[i, 1, 1] = d * (c10 * q01 + c11 * q11 + c12 * q21)
    A[i, 1, 2] = d * (c10 * q02 + c11 * q12 + c12 * q22)
    A[i, 2, 0] = d * (c20 * d00 + c21 * d01 + c22 * d02)
    A[i, 2, 1] = d * (c20 * q01 + c21 * q11 + c22 * q21)
    A[i, 2, 2] = d * (c20 * q02 + c21 * q12 + c22 * q22)
    b[i, 0] = d * (c00 * f0 + c01 * f1 + c02 * f2)
    b[i, 1] = d * (c10 * f0 + c11 * f1 + c12 * f2)
    b[i, 2] = d * (c20 * f0 + c21 * f1 + c22 * f2)
    return f0 * f0 + f1 * f1 + f2 * f2


@kernel
def _line_search(nc, p, merit):
    """Halve the step until the merit falls below the given one; return the step."""
    step = 1.0
    for _ in range(HALVINGS):
        after = 0.0
        for i in range(nc):
            s, mu = p.scale[i], p.mu[i]
            r0, r1, r2 = (
                p.r[i, 0] + step * p.dx[i, 0],
                p.r[i, 1] + step * p.dx[i, 1],
                p.r[i, 2] + step * p.dx[i, 2],
            )
            u0, u1, u2 = (
                p.u[i, 0] + step * p.dy[i, 0],
                p.u[i, 1] + step * p.dy[i, 1],
                p.u[i, 2] + step * p.dy[i, 2],
            )
            slip = np.sqrt(u1 * u1 + u2 * u2)
            f0, f1, f2 = project(mu, s * r0 - u0 - mu * slip, s * r1 - u1, s * r2 - u2)
            after += (s * r0 - f0) ** 2 + (s * r1 - f1) ** 2 + (s * r2 - f2) ** 2
        if after <= (1 - 1e-2 * step) * merit:
            break
        step *= 0.5
    return step
