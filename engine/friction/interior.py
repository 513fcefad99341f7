"""Interior-point method with Nesterov-Todd scaling: sure from any start, for problems on which Newton creeps.

With x = c (mu r_N, r_T) s and y = c (u_N + mu |u_T|, mu u_T), c = 1/max(1, mu), s the contact's Delassus scale, the
problem is x o y = 0 in the second-order cones. The iterates stay inside the cones and follow x o y = 2 m e, m -> 0
(Mehrotra's predictor and corrector). At the scaling point W, W y = W^-1 x = l, the linearised condition is
W^-1 dx + W dy = l^-1 o (...), hence dx = d - W^2 dy; and dy = D E G dw - miss with E the derivative of the shift
mu |u_T|. One system in w remains, as in `newton`; the term E is what makes Coulomb's law not a convex problem.
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
)
from engine.friction.cone import residual
from engine.kernels.jit import kernel

TO_BOUNDARY = 0.9
STALL = 12  # steps without halving the residual


@kernel
def interior_point(n, nc, p, mean, tolerance, coupled, limit):
    """Solve from scratch; leave the best impulses in ``p.r``; return the steps spent and the residual reached.

    Not ``coupled``: solve the convex problem in which the shift mu |u_T| is not a function of u but given, inside q.
    """
    size = 0.0
    for i in range(nc):
        size = max(size, p.q[i, 0] ** 2 + p.q[i, 1] ** 2 + p.q[i, 2] ** 2)
    size = np.sqrt(size)
    p.w[:] = 0.0
    for i in range(nc):
        p.x[i, 0], p.x[i, 1], p.x[i, 2] = size, 0.0, 0.0
        p.y[i, 0], p.y[i, 1], p.y[i, 2] = size, 0.0, 0.0
    best, stalled, iteration = np.inf, 0, 0
    while True:
        for i in range(nc):
            to_impulse(p, i, p.x[i], p.r[i])
        p.lag[:] = p.w
        finish(nc, p)  # overwrites w with G' r; the iterate's own w is kept in lag
        reached = residual(nc, p.mu, p.r, p.u, p.q, mean, coupled)
        if reached < best:
            stalled = 0 if reached < 0.5 * best else stalled + 1
            best = reached
            p.best[:nc] = p.r[:nc]
        else:
            stalled += 1
        if not reached < np.inf or best <= tolerance or iteration == limit or stalled > STALL:
            break
        iteration += 1
        for k in range(n):
            own = p.lag[k]
            p.lag[k] = own - p.w[k]
            p.w[k] = own
        gap = _scaled_system(n, nc, p, coupled)
        for i in range(nc):
            for k in range(3):
                p.b[i, k] = -p.x[i, k]
        step = min(1.0, _direction(n, nc, p, coupled))
        ahead = 0.0
        for i in range(nc):
            for k in range(3):
                ahead += (p.x[i, k] + step * p.dx[i, k]) * (p.y[i, k] + step * p.dy[i, k])
        centring = min(max(ahead / (nc * gap), 0.0), 1.0) ** 3
        for i in range(nc):
            if p.mu[i] > 0.0:
                _corrector(p.W[i], p.x[i], p.y[i], p.dx[i], p.dy[i], centring * gap, p.b[i])
            else:
                p.b[i, 0] = (centring * gap - p.dx[i, 0] * p.dy[i, 0]) / p.y[i, 0] - p.x[i, 0]
        step = min(1.0, TO_BOUNDARY * _direction(n, nc, p, coupled))
        for i in range(nc):
            for k in range(3):
                p.x[i, k] += step * p.dx[i, k]
                p.y[i, k] += step * p.dy[i, k]
        for k in range(n):
            p.w[k] += step * p.dw[k]
    p.r[:nc] = p.best[:nc]
    finish(nc, p)
    return iteration, best


@kernel
def to_impulse(p, i, x, r):
    """Write the impulse that belongs to the scaled x."""
    mu, f = p.mu[i], max(1.0, p.mu[i]) / p.scale[i]
    if mu > 0.0:
        r[0], r[1], r[2] = f * x[0] / mu, f * x[1], f * x[2]
    else:
        r[0], r[1], r[2] = f * x[0], 0.0, 0.0


@kernel
def _scaled_system(n, nc, p, coupled):
    """Scale at the present point: write W, the misses and the factorised system; return the mean of x . y."""
    gap = 0.0
    start_system(n, p.factor)
    for i in range(nc):
        mu, c, A, W, x, y = p.mu[i], 1 / max(1.0, p.mu[i]), p.A[i], p.W[i], p.x[i], p.y[i]
        u0, u1, u2 = relative(p, i, p.w)
        u0, u1, u2 = u0 + p.q[i, 0], u1 + p.q[i, 1], u2 + p.q[i, 2]
        gap += x[0] * y[0] + x[1] * y[1] + x[2] * y[2]
        if mu > 0.0:
            slip = np.sqrt(u1 * u1 + u2 * u2) if coupled else 0.0
            t1, t2 = 0.0, 0.0
            if slip > 0.0:
                t1, t2 = mu * u1 / slip, mu * u2 / slip
            p.miss[i, 0] = y[0] - c * (u0 + mu * slip)
            p.miss[i, 1], p.miss[i, 2] = y[1] - c * mu * u1, y[2] - c * mu * u2
            _scaling(x, y, W)
            f = 1 / p.scale[i]  # A = dr/dx W^2 D E: the c of dx/dr and of D cancel
            for k in range(3):
                row = f / mu if k == 0 else f
                s0 = W[k, 0] * W[0, 0] + W[k, 1] * W[1, 0] + W[k, 2] * W[2, 0]
                s1 = W[k, 0] * W[0, 1] + W[k, 1] * W[1, 1] + W[k, 2] * W[2, 1]
                s2 = W[k, 0] * W[0, 2] + W[k, 1] * W[1, 2] + W[k, 2] * W[2, 2]
                A[k, 0], A[k, 1], A[k, 2] = row * s0, row * (t1 * s0 + mu * s1), row * (t2 * s0 + mu * s2)
        else:
            p.miss[i, 0], p.miss[i, 1], p.miss[i, 2] = y[0] - u0, 0.0, 0.0
            A[:] = 0.0
            A[0, 0] = x[0] / (y[0] * p.scale[i])
        add_block(p, i, A, p.factor)
    factorise(n, p.factor)
    return gap / nc


@kernel
def _scaling(x, y, W):
    """Write the Nesterov-Todd scaling, W y = W^-1 x."""
    ax, ay = _root_determinant(x), _root_determinant(y)
    g = np.sqrt(0.5 * (1 + (x[0] * y[0] + x[1] * y[1] + x[2] * y[2]) / (ax * ay)))
    w0 = (x[0] / ax + y[0] / ay) / (2 * g)
    w1 = (x[1] / ax - y[1] / ay) / (2 * g)
    w2 = (x[2] / ax - y[2] / ay) / (2 * g)
    eta, k = np.sqrt(ax / ay), 1 / (1 + w0)
    W[0, 0], W[0, 1], W[0, 2] = eta * w0, eta * w1, eta * w2
    W[1, 0], W[1, 1], W[1, 2] = eta * w1, eta * (1 + k * w1 * w1), eta * k * w1 * w2
    W[2, 0], W[2, 1], W[2, 2] = eta * w2, eta * k * w1 * w2, eta * (1 + k * w2 * w2)


@kernel
def _root_determinant(x):
    """Square root of x_0^2 - |x_T|^2, kept above zero."""
    t = np.sqrt(x[1] * x[1] + x[2] * x[2])
    return np.sqrt(max((x[0] - t) * (x[0] + t), 1e-300))


@kernel
def _corrector(W, x, y, dx, dy, target, d):
    """Write d = W l^-1 o (target e - l o l - (W^-1 dx) o (W dy)), l = W y."""
    l0, p0 = _row(W, 0, y), _row(W, 0, dy)
    l1, p1 = _row(W, 1, y), _row(W, 1, dy)
    l2, p2 = _row(W, 2, y), _row(W, 2, dy)
    f = 1 / (W[0, 0] * W[0, 0] - W[0, 1] * W[0, 1] - W[0, 2] * W[0, 2])  # W^-1 = f J W J, J = diag(1, -1, -1)
    s0 = f * (W[0, 0] * dx[0] - W[0, 1] * dx[1] - W[0, 2] * dx[2])
    s1 = f * (-W[1, 0] * dx[0] + W[1, 1] * dx[1] + W[1, 2] * dx[2])
    s2 = f * (-W[2, 0] * dx[0] + W[2, 1] * dx[1] + W[2, 2] * dx[2])
    e0 = target - (l0 * l0 + l1 * l1 + l2 * l2) - (p0 * s0 + p1 * s1 + p2 * s2)
    e1 = -2 * l0 * l1 - (p0 * s1 + s0 * p1)
    e2 = -2 * l0 * l2 - (p0 * s2 + s0 * p2)
    t = np.sqrt(l1 * l1 + l2 * l2)
    det, le = max((l0 - t) * (l0 + t), 1e-300), l1 * e1 + l2 * e2
    h0 = (l0 * e0 - le) / det
    h1 = (e1 - l1 * h0) / l0
    h2 = (e2 - l2 * h0) / l0
    for k in range(3):
        d[k] = W[k, 0] * h0 + W[k, 1] * h1 + W[k, 2] * h2


@kernel
def _row(W, k, v):
    return W[k, 0] * v[0] + W[k, 1] * v[1] + W[k, 2] * v[2]


@kernel
def _direction(n, nc, p, coupled):
    """Write dw, dx, dy for the right-hand sides in ``p.b``; return how far the cones allow to go."""
    rhs = p.dw
    for k in range(n):
        rhs[k] = -p.lag[k]
    for i in range(nc):
        W, m = p.W[i], p.miss[i]
        f = max(1.0, p.mu[i]) / p.scale[i]
        if p.mu[i] > 0.0:
            z0, z1, z2 = _row(W, 0, m), _row(W, 1, m), _row(W, 2, m)
            d0 = p.b[i, 0] + W[0, 0] * z0 + W[0, 1] * z1 + W[0, 2] * z2
            d1 = p.b[i, 1] + W[1, 0] * z0 + W[1, 1] * z1 + W[1, 2] * z2
            d2 = p.b[i, 2] + W[2, 0] * z0 + W[2, 1] * z1 + W[2, 2] * z2
            add_impulse(p, i, f * d0 / p.mu[i], f * d1, f * d2, rhs)
        else:
            add_impulse(p, i, f * (p.b[i, 0] + p.x[i, 0] / p.y[i, 0] * m[0]), 0.0, 0.0, rhs)
    substitute(n, p.factor, rhs)
    step = 1e3
    for i in range(nc):
        mu, c, W, dx, dy = p.mu[i], 1 / max(1.0, p.mu[i]), p.W[i], p.dx[i], p.dy[i]
        d0, d1, d2 = relative(p, i, rhs)
        if mu > 0.0:
            u0, u1, u2 = relative(p, i, p.w)
            u1, u2 = u1 + p.q[i, 1], u2 + p.q[i, 2]
            slip = np.sqrt(u1 * u1 + u2 * u2)
            if coupled and slip > 0.0:
                d0 += mu * (u1 * d1 + u2 * d2) / slip
            dy[0] = c * d0 - p.miss[i, 0]
            dy[1], dy[2] = c * mu * d1 - p.miss[i, 1], c * mu * d2 - p.miss[i, 2]
            z0, z1, z2 = _row(W, 0, dy), _row(W, 1, dy), _row(W, 2, dy)
            for k in range(3):
                dx[k] = p.b[i, k] - (W[k, 0] * z0 + W[k, 1] * z1 + W[k, 2] * z2)
        else:
            dy[0], dy[1], dy[2] = d0 - p.miss[i, 0], 0.0, 0.0
            dx[0], dx[1], dx[2] = p.b[i, 0] - p.x[i, 0] / p.y[i, 0] * dy[0], 0.0, 0.0
        step = min(step, _to_boundary(p.x[i], dx), _to_boundary(p.y[i], dy))
    return step


@kernel
def _to_boundary(x, d):
    """Return the largest step along d that stays in the second-order cone."""
    a = d[0] * d[0] - d[1] * d[1] - d[2] * d[2]
    b = x[0] * d[0] - x[1] * d[1] - x[2] * d[2]
    c = x[0] * x[0] - x[1] * x[1] - x[2] * x[2]
    root = b * b - a * c
    step = 1e3
    if a < 0.0:
        step = (-b - np.sqrt(max(root, 0.0))) / a
    elif root > 0.0 and b < 0.0:
        step = c / (-b + np.sqrt(root))
    if d[0] < 0.0:
        step = min(step, -x[0] / d[0])
    return max(step, 0.0)
