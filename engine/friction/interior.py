"""Interior-point method with Nesterov-Todd scaling: for problems on which Newton creeps.

With x = c (mu r_N, r_T) s and y = c (u_N + mu |u_T|, mu u_T), c = 1/max(1, mu), s the contact's Delassus scale, the
problem is x o y = 0 in the second-order cones. The iterates stay inside the cones and follow x o y = 2 m e, m -> 0
(Mehrotra's predictor and corrector). At the scaling point W, W y = W^-1 x = l, the linearised condition is
W^-1 dx + W dy = l^-1 o (...), hence dx = d - W^2 dy; and dy = D E G dw - miss with E the derivative of the shift
mu |u_T|. One system in w remains, as in `newton`; the term E is what makes Coulomb's law not a convex problem.
"""

import numpy as np

from engine.friction.arrays import add_impulse, copy, finish, relative
from engine.friction.banded import add_blocks, factorise, start_system, substitute
from engine.friction.bilateral import add_bilateral
from engine.friction.cone import residual
from engine.jit import inner

TO_BOUNDARY = 0.95
STALL = 12  # steps without halving the residual


@inner
def interior_point(n, nc, p, goal, inside, limit):
    """Solve from the impulses given, moved inside the cones by ``inside`` times the load.

    Parameters
    ----------
    n, nc : int
        Numbers of unknowns and contacts.
    p : FrictionArrays
        Leaves the best impulses in ``p.r``.
    goal : Goal
    inside : float
        Share of the load.
    limit : int
        Largest number of steps.

    Returns
    -------
    steps : int
    residual : float
        The smallest one reached.
    """
    size = 0.0
    for i in range(nc):
        size = max(size, p.q[i, 0] ** 2 + p.q[i, 1] ** 2 + p.q[i, 2] ** 2)
    finish(n, nc, p)
    for i in range(nc):
        _start(i, p.mu[i], p.scale[i], p.r, p.u, inside * np.sqrt(size), p.x, p.y)
    best, stalled, iteration = np.inf, 0, 0
    while True:
        for i in range(nc):
            _to_impulse(i, p.mu[i], p.scale[i], p.x, p.r)
        finish(n, nc, p)
        reached = residual(nc, p.mu, p.r, p.u, p.q, goal.scale)
        stalled = 0 if reached < 0.5 * best else stalled + 1
        if reached < best:
            best = reached
            copy(nc, p.r, p.best)
        if not reached < np.inf or best <= goal.tolerance or iteration == limit or stalled > STALL:
            break
        iteration += 1
        gap = _scaled_system(n, nc, p)
        for i in range(nc):
            for k in range(3):
                p.b[i, k] = -p.x[i, k]
        target = 0.0
        for corrected in range(2):
            step = min(1.0, (TO_BOUNDARY if corrected else 1.0) * _direction(n, nc, p))
            if not corrected:
                ahead = 0.0
                for i in range(nc):
                    for k in range(3):
                        ahead += (p.x[i, k] + step * p.dr[i, k]) * (p.y[i, k] + step * p.du[i, k])
                target = gap * min(max(ahead / (nc * gap), 0.0), 1.0) ** 3
                for i in range(nc):
                    _corrector(i, p.mu[i], p.Q, p.x, p.y, p.dr, p.du, target, p.b)
        for i in range(nc):
            for k in range(3):
                p.x[i, k] += step * p.dr[i, k]
                p.y[i, k] += step * p.du[i, k]
    copy(nc, p.best, p.r)
    finish(n, nc, p)
    return iteration, best


@inner
def _start(i, mu, scale, r, u, inside, x, y):
    """Write the first x and y of contact i, both inside the cone."""
    c, slip = 1 / max(1.0, mu), np.sqrt(u[i, 1] ** 2 + u[i, 2] ** 2)
    if mu > 0.0:
        x[i, 1], x[i, 2] = c * scale * r[i, 1], c * scale * r[i, 2]
        y[i, 1], y[i, 2] = c * mu * u[i, 1], c * mu * u[i, 2]
        x[i, 0] = inside + max(c * mu * scale * r[i, 0], np.sqrt(x[i, 1] ** 2 + x[i, 2] ** 2))
        y[i, 0] = inside + max(c * (u[i, 0] + mu * slip), c * mu * slip)
    else:
        x[i, 0], x[i, 1], x[i, 2] = inside + max(scale * r[i, 0], 0.0), 0.0, 0.0
        y[i, 0], y[i, 1], y[i, 2] = inside + max(u[i, 0], 0.0), 0.0, 0.0


@inner
def _to_impulse(i, mu, scale, x, r):
    """Write the impulse that belongs to the scaled x."""
    f = max(1.0, mu) / scale
    if mu > 0.0:
        r[i, 0], r[i, 1], r[i, 2] = f * x[i, 0] / mu, f * x[i, 1], f * x[i, 2]
    else:
        r[i, 0], r[i, 1], r[i, 2] = f * x[i, 0], 0.0, 0.0


@inner
def _scaled_system(n, nc, p):
    """Scale at the present point: write W, the misses and the factorised system; return the mean of x . y."""
    gap, x, y, u, W = 0.0, p.x, p.y, p.u, p.Q
    start_system(n, p.K)
    add_bilateral(p.bilateral, p.K)
    for i in range(nc):
        mu, c, f = p.mu[i], 1 / max(1.0, p.mu[i]), 1 / p.scale[i]
        gap += x[i, 0] * y[i, 0] + x[i, 1] * y[i, 1] + x[i, 2] * y[i, 2]
        if mu > 0.0:
            slip = np.sqrt(u[i, 1] * u[i, 1] + u[i, 2] * u[i, 2])
            t1, t2 = 0.0, 0.0
            if slip > 0.0:
                t1, t2 = mu * u[i, 1] / slip, mu * u[i, 2] / slip
            p.miss[i, 0] = y[i, 0] - c * (u[i, 0] + mu * slip)
            p.miss[i, 1], p.miss[i, 2] = y[i, 1] - c * mu * u[i, 1], y[i, 2] - c * mu * u[i, 2]
            _scaling(i, x, y, W)
            for k in range(3):  # A = dr/dx W^2 D E: the c of dx/dr and of D cancel
                row = f / mu if k == 0 else f
                s0 = _row(W, i, k, W[i, 0, 0], W[i, 1, 0], W[i, 2, 0])
                s1 = _row(W, i, k, W[i, 0, 1], W[i, 1, 1], W[i, 2, 1])
                s2 = _row(W, i, k, W[i, 0, 2], W[i, 1, 2], W[i, 2, 2])
                p.A[i, k, 0], p.A[i, k, 1], p.A[i, k, 2] = (
                    row * s0,
                    row * (t1 * s0 + mu * s1),
                    row * (t2 * s0 + mu * s2),
                )
        else:
            p.miss[i, 0], p.miss[i, 1], p.miss[i, 2] = y[i, 0] - u[i, 0], 0.0, 0.0
            for k in range(3):
                p.A[i, k, 0], p.A[i, k, 1], p.A[i, k, 2] = 0.0, 0.0, 0.0
            p.A[i, 0, 0] = f * x[i, 0] / y[i, 0]
    add_blocks(nc, p.rows, p.mu, p.A, p.block, p.K)
    factorise(n, p.K)
    return gap / nc


@inner
def _row(W, i, k, v0, v1, v2):
    """Return row k of the block W_i times a vector."""
    return W[i, k, 0] * v0 + W[i, k, 1] * v1 + W[i, k, 2] * v2


@inner
def _scaling(i, x, y, W):
    """Write the Nesterov-Todd scaling, W y = W^-1 x."""
    ax, ay = _root_determinant(x[i, 0], x[i, 1], x[i, 2]), _root_determinant(y[i, 0], y[i, 1], y[i, 2])
    g = np.sqrt(0.5 * (1 + (x[i, 0] * y[i, 0] + x[i, 1] * y[i, 1] + x[i, 2] * y[i, 2]) / (ax * ay)))
    w0 = (x[i, 0] / ax + y[i, 0] / ay) / (2 * g)
    w1 = (x[i, 1] / ax - y[i, 1] / ay) / (2 * g)
    w2 = (x[i, 2] / ax - y[i, 2] / ay) / (2 * g)
    eta, k = np.sqrt(ax / ay), 1 / (1 + w0)
    W[i, 0, 0], W[i, 0, 1], W[i, 0, 2] = eta * w0, eta * w1, eta * w2
    W[i, 1, 0], W[i, 1, 1], W[i, 1, 2] = eta * w1, eta * (1 + k * w1 * w1), eta * k * w1 * w2
    W[i, 2, 0], W[i, 2, 1], W[i, 2, 2] = eta * w2, eta * k * w1 * w2, eta * (1 + k * w2 * w2)


@inner
def _root_determinant(x0, x1, x2):
    """Return the square root of x_0^2 - |x_T|^2, kept above zero."""
    t = np.sqrt(x1 * x1 + x2 * x2)
    return np.sqrt(max((x0 - t) * (x0 + t), 1e-300))


@inner
def _corrector(i, mu, W, x, y, dx, dy, target, d):
    """Write d = W l^-1 o (target e - l o l - (W^-1 dx) o (W dy)), l = W y."""
    if mu == 0.0:
        d[i, 0] = (target - dx[i, 0] * dy[i, 0]) / y[i, 0] - x[i, 0]
        return
    l0, p0 = _row(W, i, 0, y[i, 0], y[i, 1], y[i, 2]), _row(W, i, 0, dy[i, 0], dy[i, 1], dy[i, 2])
    l1, p1 = _row(W, i, 1, y[i, 0], y[i, 1], y[i, 2]), _row(W, i, 1, dy[i, 0], dy[i, 1], dy[i, 2])
    l2, p2 = _row(W, i, 2, y[i, 0], y[i, 1], y[i, 2]), _row(W, i, 2, dy[i, 0], dy[i, 1], dy[i, 2])
    f = 1 / (W[i, 0, 0] ** 2 - W[i, 0, 1] ** 2 - W[i, 0, 2] ** 2)  # W^-1 = f J W J, J = diag(1, -1, -1)
    s0 = f * _row(W, i, 0, dx[i, 0], -dx[i, 1], -dx[i, 2])
    s1 = -f * _row(W, i, 1, dx[i, 0], -dx[i, 1], -dx[i, 2])
    s2 = -f * _row(W, i, 2, dx[i, 0], -dx[i, 1], -dx[i, 2])
    e0 = target - (l0 * l0 + l1 * l1 + l2 * l2) - (p0 * s0 + p1 * s1 + p2 * s2)
    e1 = -2 * l0 * l1 - (p0 * s1 + s0 * p1)
    e2 = -2 * l0 * l2 - (p0 * s2 + s0 * p2)
    t = np.sqrt(l1 * l1 + l2 * l2)
    det, le = max((l0 - t) * (l0 + t), 1e-300), l1 * e1 + l2 * e2
    h0 = (l0 * e0 - le) / det
    h1 = (e1 - l1 * h0) / l0
    h2 = (e2 - l2 * h0) / l0
    for k in range(3):
        d[i, k] = _row(W, i, k, h0, h1, h2)


@inner
def _direction(n, nc, p):
    """Write dx and dy for the right-hand sides in ``p.b``; return how far the cones allow to go."""
    W, m, b, dx, dy, u = p.Q, p.miss, p.b, p.dr, p.du, p.u
    for k in range(n):
        p.dw[k] = 0.0
    for i in range(nc):
        f = max(1.0, p.mu[i]) / p.scale[i]
        if p.mu[i] > 0.0:
            z0 = _row(W, i, 0, m[i, 0], m[i, 1], m[i, 2])
            z1 = _row(W, i, 1, m[i, 0], m[i, 1], m[i, 2])
            z2 = _row(W, i, 2, m[i, 0], m[i, 1], m[i, 2])
            d0 = b[i, 0] + _row(W, i, 0, z0, z1, z2)
            d1 = b[i, 1] + _row(W, i, 1, z0, z1, z2)
            d2 = b[i, 2] + _row(W, i, 2, z0, z1, z2)
            add_impulse(p.rows, i, f * d0 / p.mu[i], f * d1, f * d2, p.dw)
        else:
            add_impulse(p.rows, i, f * (b[i, 0] + p.x[i, 0] / p.y[i, 0] * m[i, 0]), 0.0, 0.0, p.dw)
    substitute(n, p.K, p.dw)
    step = 1e3
    for i in range(nc):
        mu, c = p.mu[i], 1 / max(1.0, p.mu[i])
        d0, d1, d2 = relative(p.rows, i, p.dw)
        if mu > 0.0:
            slip = np.sqrt(u[i, 1] * u[i, 1] + u[i, 2] * u[i, 2])
            if slip > 0.0:
                d0 += mu * (u[i, 1] * d1 + u[i, 2] * d2) / slip
            dy[i, 0] = c * d0 - m[i, 0]
            dy[i, 1], dy[i, 2] = c * mu * d1 - m[i, 1], c * mu * d2 - m[i, 2]
            z0 = _row(W, i, 0, dy[i, 0], dy[i, 1], dy[i, 2])
            z1 = _row(W, i, 1, dy[i, 0], dy[i, 1], dy[i, 2])
            z2 = _row(W, i, 2, dy[i, 0], dy[i, 1], dy[i, 2])
            for k in range(3):
                dx[i, k] = b[i, k] - _row(W, i, k, z0, z1, z2)
        else:
            dy[i, 0], dy[i, 1], dy[i, 2] = d0 - m[i, 0], 0.0, 0.0
            dx[i, 0], dx[i, 1], dx[i, 2] = b[i, 0] - p.x[i, 0] / p.y[i, 0] * dy[i, 0], 0.0, 0.0
        step = min(step, _to_boundary(i, p.x, dx), _to_boundary(i, p.y, dy))
    return step


@inner
def _to_boundary(i, x, d):
    """Return the largest step along d that stays in the second-order cone."""
    a = d[i, 0] ** 2 - d[i, 1] ** 2 - d[i, 2] ** 2
    b = x[i, 0] * d[i, 0] - x[i, 1] * d[i, 1] - x[i, 2] * d[i, 2]
    c = x[i, 0] ** 2 - x[i, 1] ** 2 - x[i, 2] ** 2
    root = b * b - a * c
    step = 1e3
    if a < 0.0:
        step = (-b - np.sqrt(max(root, 0.0))) / a
    elif root > 0.0 and b < 0.0:
        step = c / (-b + np.sqrt(root))
    if d[i, 0] < 0.0:
        step = min(step, -x[i, 0] / d[i, 0])
    return max(step, 0.0)
