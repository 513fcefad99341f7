"""Interior-point method with Nesterov-Todd scaling, for problems on which Newton's method converges slowly.

With x = c (mu r_N, r_T) s and y = c (u_N + mu |u_T|, mu u_T), c = 1/max(1, mu), s the contact's Delassus scale, the
problem is x o y = 0 in the second-order cones. The iterates stay inside the cones and follow x o y = 2 m e, m -> 0
(Mehrotra's predictor and corrector). At the scaling point W, W y = W^-1 x = l, the linearised condition is
W^-1 dx + W dy = l^-1 o (...), hence dx = d - W^2 dy; and dy = D E du - miss with E the derivative of the shift
mu |u_T|. With du = G dw + C dr, dr = (I + C A)^-1 (b - A G dw), one system in w remains, as in `newton`. The term E is
the reason why Coulomb's law is not a convex problem.

Two measures of a careful pace lead past folds that defeat other methods. First, only a share of the shift is applied,
zero at the start: without the shift the problem is convex, with one solution that interior-point methods find from any
point, and the iterates follow the solution as the share grows. Second, after the cones have shortened a step, the next
direction uses a smaller share of E, closer to the convex problem's direction, which leads away from the boundary.
"""

from typing import NamedTuple

import numpy as np

from engine.friction.arrays import add_impulse, all_relative, copy, finish
from engine.friction.bilateral import add_bilateral
from engine.friction.blocks import add_contact, clear, factorise, start_system, substitute
from engine.friction.complementarity import read_matrix, residual, write_matrix
from engine.jit import inner
from engine.jit.lanes import LANES, choose, larger, least, read, root, spread, total, write

TINY = 1e-300
FAR = 1e3  # upper limit of the step, as a multiple of the direction


class Pace(NamedTuple):
    """How fast the method proceeds from the convex problem to Coulomb's."""

    share: float  # share of the shift mu |u_T| applied in the first step
    rise: float  # increase of that share after a full step
    caution: float  # relative reduction of the share of E in the next direction after a step of zero length
    reach: float  # largest step, as a share of the distance to the boundary of the cones


BOLD = Pace(1.0, 0.0, 0.0, 0.95)  # always Newton's direction: few steps if the start is near the solution
CONVEX = Pace(0.0, 0.0, 0.0, 0.95)  # the convex problem, to the end


@inner
def interior_point(nc, p, goal, inside, pace, effort):
    """Solve from the current impulses, moved inside the cones by ``inside`` times the load; return steps and residual.

    The best impulses are left in the lanes of p. The method is abandoned after ``effort.patience`` steps without
    halving the residual, counted once the whole shift is applied. If the share does not rise, the residual has it too.
    """
    c, size, share = p.contacts, 0.0, pace.share
    for i in range(nc):
        size = max(size, c.q[0, i] ** 2 + c.q[1, i] ** 2 + c.q[2, i] ** 2)
    finish(nc, p)
    _start(c, inside * np.sqrt(size), share)
    best, stalled, iteration, step = np.inf, 0, 0, 1.0
    while True:
        _to_impulses(c)
        finish(nc, p)
        reached = residual(c, goal.scale, share if pace.rise == 0.0 else 1.0)
        stalled = 0 if reached < 0.5 * best or share < 1.0 else stalled + 1
        if reached < best:
            best = reached
            copy(c.r, c.best)
        if not reached < np.inf or best <= goal.tolerance or iteration == effort.most or stalled > effort.patience:
            break
        if iteration > 0:
            share = min(1.0, share + pace.rise * step)
        iteration += 1
        slope = share * (1.0 - pace.caution * (1.0 - step))
        gap = _scaled_system(nc, p, share, slope)
        target = 0.0
        for corrected in range(2):
            _right_hand_side(c, target, corrected > 0)
            step = min(1.0, (pace.reach if corrected else 1.0) * _direction(nc, p, slope))
            if not corrected:
                # Mehrotra's choice: the cube of the share of the gap that the predictor leaves
                target = gap * min(max(_gap_after(c, step) / (nc * gap), 0.0), 1.0) ** 3
        for k in range(3):
            for i in range(0, nc, LANES):
                write(read(c.x[k], i) + step * read(c.dr[k], i), c.x[k], i)
                write(read(c.y[k], i) + step * read(c.du[k], i), c.y[k], i)
    copy(c.best, c.r)
    finish(nc, p)
    return iteration, best


@inner
def _start(c, inside, share):
    """Write the initial x and y, both inside the cones; y includes a share of the shift."""
    for i in range(0, c.mu.shape[0], LANES):
        mu, s, f = read(c.mu, i), read(c.scale, i), 1 / larger(read(c.mu, i), 1.0)
        u0, u1, u2 = read(c.u[0], i), read(c.u[1], i), read(c.u[2], i)
        rough, slip = mu > 0.0, mu * root(u1 * u1 + u2 * u2)
        x0 = f * choose(rough, mu, 1.0) * s * read(c.r[0], i)
        x1 = choose(rough, f * s * read(c.r[1], i), 0.0)
        x2 = choose(rough, f * s * read(c.r[2], i), 0.0)
        write(inside + larger(x0, root(x1 * x1 + x2 * x2)), c.x[0], i)
        write(x1, c.x[1], i)
        write(x2, c.x[2], i)
        write(inside + larger(f * (u0 + share * slip), f * slip), c.y[0], i)
        write(f * mu * u1, c.y[1], i)
        write(f * mu * u2, c.y[2], i)


@inner
def _to_impulses(c):
    """Write the impulses from the scaled x."""
    for i in range(0, c.mu.shape[0], LANES):
        mu, there = read(c.mu, i), read(c.present, i) > 0.0  # past the last contact x may be NaN
        f = larger(mu, 1.0) / read(c.scale, i)
        write(choose(there, f * read(c.x[0], i) / choose(mu > 0.0, mu, 1.0), 0.0), c.r[0], i)
        write(choose(there, f * read(c.x[1], i), 0.0), c.r[1], i)
        write(choose(there, f * read(c.x[2], i), 0.0), c.r[2], i)


@inner
def _scaled_system(nc, p, share, slope):
    """Write W, the misses and the factorised system, for given shares of the shift and E; return the mean of x . y."""
    c, gap = p.contacts, spread(0.0)
    for i in range(0, nc, LANES):
        mu, f = read(c.mu, i), 1 / larger(read(c.mu, i), 1.0)
        x0, x1, x2 = read(c.x[0], i), read(c.x[1], i), read(c.x[2], i)
        y0, y1, y2 = read(c.y[0], i), read(c.y[1], i), read(c.y[2], i)
        u0, u1, u2 = read(c.u[0], i), read(c.u[1], i), read(c.u[2], i)
        gap += choose(read(c.present, i) > 0.0, x0 * y0 + x1 * y1 + x2 * y2, 0.0)
        slip = root(u1 * u1 + u2 * u2)
        t1, t2 = slope * mu * u1 / larger(slip, TINY), slope * mu * u2 / larger(slip, TINY)
        write(y0 - f * (u0 + share * mu * slip), c.miss[0], i)
        write(y1 - f * mu * u1, c.miss[1], i)
        write(y2 - f * mu * u2, c.miss[2], i)
        w00, w01, w02, w11, w12, w22 = scaling(x0, x1, x2, y0, y1, y2)
        write_matrix(c.Q, i, w00, w01, w02, w01, w11, w12, w02, w12, w22)
        s00, s01, s02 = (
            w00 * w00 + w01 * w01 + w02 * w02,
            w00 * w01 + w01 * w11 + w02 * w12,
            w00 * w02 + w01 * w12 + w02 * w22,
        )
        s11, s12, s22 = (
            w01 * w01 + w11 * w11 + w12 * w12,
            w01 * w02 + w11 * w12 + w12 * w22,
            w02 * w02 + w12 * w12 + w22 * w22,
        )
        k = 1 / read(c.scale, i)  # A = dr/dx W^2 D E: the factors 1/max(1, mu) of dx/dr and of D cancel
        n = k / choose(mu > 0.0, mu, 1.0)
        a00, a01, a02 = n * s00, n * (t1 * s00 + mu * s01), n * (t2 * s00 + mu * s02)
        a10, a11, a12 = k * s01, k * (t1 * s01 + mu * s11), k * (t2 * s01 + mu * s12)
        a20, a21, a22 = k * s02, k * (t1 * s02 + mu * s12), k * (t2 * s02 + mu * s22)
        write_matrix(c.A, i, a00, a01, a02, a10, a11, a12, a20, a21, a22)
        _give_way(i, read(c.compliance, i), c.A, c.yielding)
    start_system(p.system, p.K)
    add_bilateral(p.bilateral, p.K)
    for i in range(nc):
        add_contact(p.rows, i, c.A, p.mu[i] == 0.0, p.K)
    factorise(p.system, p.K, p.F)
    return total(gap) / nc


@inner
def _give_way(i, compliance, A, Y):
    """Write Y = (I + c A)^-1 of eight contacts from i on, and overwrite A with Y A."""
    a00, a01, a02, a10, a11, a12, a20, a21, a22 = read_matrix(A, i)
    m00, m01, m02 = 1 + compliance * a00, compliance * a01, compliance * a02
    m10, m11, m12 = compliance * a10, 1 + compliance * a11, compliance * a12
    m20, m21, m22 = compliance * a20, compliance * a21, 1 + compliance * a22
    c00, c01, c02 = m11 * m22 - m12 * m21, m02 * m21 - m01 * m22, m01 * m12 - m02 * m11
    c10, c11, c12 = m12 * m20 - m10 * m22, m00 * m22 - m02 * m20, m02 * m10 - m00 * m12
    c20, c21, c22 = m10 * m21 - m11 * m20, m01 * m20 - m00 * m21, m00 * m11 - m01 * m10
    d = 1 / (m00 * c00 + m01 * c10 + m02 * c20)
    write_matrix(Y, i, d * c00, d * c01, d * c02, d * c10, d * c11, d * c12, d * c20, d * c21, d * c22)
    b00, b10, b20 = _product(Y, i, a00, a10, a20)
    b01, b11, b21 = _product(Y, i, a01, a11, a21)
    b02, b12, b22 = _product(Y, i, a02, a12, a22)
    write_matrix(A, i, b00, b01, b02, b10, b11, b12, b20, b21, b22)


@inner
def _product(W, i, v0, v1, v2):
    """Return the products of the blocks W from contact i on with vectors."""
    w00, w01, w02, w10, w11, w12, w20, w21, w22 = read_matrix(W, i)
    return w00 * v0 + w01 * v1 + w02 * v2, w10 * v0 + w11 * v1 + w12 * v2, w20 * v0 + w21 * v1 + w22 * v2


@inner
def _right_hand_side(c, target, corrected):
    """Write b = d of the predictor, -x, or the corrector, W l^-1 o (target e - l o l - (W^-1 dx) o (W dy)), l = W y."""
    for i in range(0, c.mu.shape[0], LANES):
        if not corrected:
            for k in range(3):
                write(-read(c.x[k], i), c.b[k], i)
            continue
        l0, l1, l2 = _product(c.Q, i, read(c.y[0], i), read(c.y[1], i), read(c.y[2], i))
        p0, p1, p2 = _product(c.Q, i, read(c.du[0], i), read(c.du[1], i), read(c.du[2], i))
        w0, w1, w2 = read(c.Q[0], i), read(c.Q[1], i), read(c.Q[2], i)
        f = 1 / (w0 * w0 - w1 * w1 - w2 * w2)  # W^-1 = f J W J, J = diag(1, -1, -1)
        s0, s1, s2 = _product(c.Q, i, f * read(c.dr[0], i), -f * read(c.dr[1], i), -f * read(c.dr[2], i))
        e0 = target - (l0 * l0 + l1 * l1 + l2 * l2) - (p0 * s0 - p1 * s1 - p2 * s2)
        e1 = -2 * l0 * l1 - (s0 * p1 - p0 * s1)
        e2 = -2 * l0 * l2 - (s0 * p2 - p0 * s2)
        t = root(l1 * l1 + l2 * l2)
        h0 = (l0 * e0 - (l1 * e1 + l2 * e2)) / larger((l0 - t) * (l0 + t), TINY)
        d0, d1, d2 = _product(c.Q, i, h0, (e1 - l1 * h0) / l0, (e2 - l2 * h0) / l0)
        write(d0, c.b[0], i)
        write(d1, c.b[1], i)
        write(d2, c.b[2], i)


@inner
def _direction(nc, p, slope):
    """Write dx into dr and dy into du for the right-hand sides b; return the largest step that the cones allow."""
    c = p.contacts
    for i in range(0, nc, LANES):
        mu, f = read(c.mu, i), larger(read(c.mu, i), 1.0) / read(c.scale, i)
        z0, z1, z2 = _product(c.Q, i, read(c.miss[0], i), read(c.miss[1], i), read(c.miss[2], i))
        z0, z1, z2 = _product(c.Q, i, z0, z1, z2)
        r0 = f * (read(c.b[0], i) + z0) / choose(mu > 0.0, mu, 1.0)
        r0, r1, r2 = _product(c.yielding, i, r0, f * (read(c.b[1], i) + z1), f * (read(c.b[2], i) + z2))
        write(r0, c.dr[0], i)
        write(r1, c.dr[1], i)
        write(r2, c.dr[2], i)
    clear(p.dw)
    for i in range(nc):
        add_impulse(p.rows, i, c.dr[0, i], c.dr[1, i], c.dr[2, i], p.dw)
    substitute(p.system, p.K, p.F, p.dw)
    all_relative(nc, p.rows, p.dw, c.du)
    room = spread(FAR)
    for i in range(0, nc, LANES):
        mu, f, give = read(c.mu, i), 1 / larger(read(c.mu, i), 1.0), read(c.compliance, i)
        u1, u2, d0, d1, d2 = read(c.u[1], i), read(c.u[2], i), read(c.du[0], i), read(c.du[1], i), read(c.du[2], i)
        a0, a1, a2 = _product(c.A, i, d0, d1, d2)
        d0 += give * (read(c.dr[0], i) - a0)
        d1 += give * (read(c.dr[1], i) - a1)
        d2 += give * (read(c.dr[2], i) - a2)
        d0 += slope * mu * (u1 * d1 + u2 * d2) / larger(root(u1 * u1 + u2 * u2), TINY)
        y0, y1, y2 = f * d0 - read(c.miss[0], i), f * mu * d1 - read(c.miss[1], i), f * mu * d2 - read(c.miss[2], i)
        z0, z1, z2 = _product(c.Q, i, y0, y1, y2)
        z0, z1, z2 = _product(c.Q, i, z0, z1, z2)
        x0, x1, x2 = read(c.b[0], i) - z0, read(c.b[1], i) - z1, read(c.b[2], i) - z2
        write(x0, c.dr[0], i)
        write(x1, c.dr[1], i)
        write(x2, c.dr[2], i)
        write(y0, c.du[0], i)
        write(y1, c.du[1], i)
        write(y2, c.du[2], i)
        reach_x = to_boundary(read(c.x[0], i), read(c.x[1], i), read(c.x[2], i), x0, x1, x2)
        reach_y = to_boundary(read(c.y[0], i), read(c.y[1], i), read(c.y[2], i), y0, y1, y2)
        reach = choose(reach_x < reach_y, reach_x, reach_y)
        reach = choose(read(c.present, i) > 0.0, reach, FAR)
        room = choose(reach < room, reach, room)
    return least(room)


@inner
def _gap_after(c, step):
    """Return the sum of x . y after a step."""
    gap = spread(0.0)
    for i in range(0, c.mu.shape[0], LANES):
        there = read(c.present, i) > 0.0
        for k in range(3):
            x, y = read(c.x[k], i) + step * read(c.dr[k], i), read(c.y[k], i) + step * read(c.du[k], i)
            gap += choose(there, x * y, 0.0)
    return total(gap)


@inner
def scaling(x0, x1, x2, y0, y1, y2):
    """Return the upper half of the Nesterov-Todd scaling W, W y = W^-1 x."""
    ax, ay = _root_determinant(x0, x1, x2), _root_determinant(y0, y1, y2)
    g = root(0.5 * (1 + (x0 * y0 + x1 * y1 + x2 * y2) / (ax * ay)))
    w0, w1, w2 = (x0 / ax + y0 / ay) / (2 * g), (x1 / ax - y1 / ay) / (2 * g), (x2 / ax - y2 / ay) / (2 * g)
    eta, k = root(ax / ay), 1 / (1 + w0)
    return eta * w0, eta * w1, eta * w2, eta * (1 + k * w1 * w1), eta * k * w1 * w2, eta * (1 + k * w2 * w2)


@inner
def _root_determinant(x0, x1, x2):
    """Return the square root of x_0^2 - |x_T|^2, kept above zero."""
    t = root(x1 * x1 + x2 * x2)
    return root(larger((x0 - t) * (x0 + t), TINY))


@inner
def to_boundary(x0, x1, x2, d0, d1, d2):
    """Return the largest steps along d that remain in the second-order cones."""
    a, b, c = d0 * d0 - d1 * d1 - d2 * d2, x0 * d0 - x1 * d1 - x2 * d2, x0 * x0 - x1 * x1 - x2 * x2
    square = b * b - a * c
    way = root(larger(square, 0.0))
    ahead = choose((square > 0.0) & (b < 0.0), c / (way - b), FAR)
    step = choose(a < 0.0, (-b - way) / a, ahead)
    edge = -x0 / d0
    step = choose((d0 < 0.0) & (edge < step), edge, step)
    return larger(step, 0.0)
