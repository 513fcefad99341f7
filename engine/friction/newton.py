"""Newton's method on the contacts' equations, each contact eliminated.

Every contact's equation is linearised and solved for its impulse (`complementarity`), which leaves one system in the
velocities alone, (B + sum_i G_i' A_i G_i) dw = -sum_i G_i' b_i: as many unknowns as the mechanism has degrees of
freedom, however many contacts there are and however redundant they may be.
"""

import numpy as np

from engine.friction.arrays import add_impulse, finish, relative
from engine.friction.banded import add_blocks, factorise, start_system, substitute
from engine.friction.bilateral import add_bilateral
from engine.friction.complementarity import eliminate, fischer_burmeister, mismatch, natural_map
from engine.friction.cone import residual
from engine.jit import inner

SHRINK = 0.04  # factor of tau^2 once the smoothed equation is met as well as its smoothing deserves
POOR = 0.5  # share of the merit: a step on the natural map that leaves more is a poor one
SHORT = 0.1  # share of Newton's step: a shorter step on the smoothed equation is a poor one
CREEP = 6  # poor steps in a row after which the smoothed equation is given up


@inner
def newton(n, nc, p, goal, tau2, end, proximal, effort):
    """Improve ``p.r`` by Newton's method; return the steps spent, the residual reached and tau^2.

    With ``tau2`` 0 the equation is the natural map. The line search is not monotone: a step may raise the merit above
    the present one, not above the last four; after ``patience`` poor steps in a row it is given up. Else the equation
    is the Fischer-Burmeister function, smoothed less and less until tau^2 is below ``end``, so that a wrong guess of
    which contacts open, slide and stick is left early instead of being defended; after ``CREEP`` poor steps it is given
    up above ``end``.

    Parameters
    ----------
    n, nc : int
        Numbers of unknowns and contacts.
    p : FrictionArrays
    goal : Goal
    tau2, end : float
        Smoothing tau^2 at the start and at the end.
    proximal : float
        See `complementarity.eliminate`.
    effort : Effort
    """
    finish(n, nc, p)
    reached = residual(nc, p.mu, p.r, p.u, p.q, goal.scale)
    natural, iteration, poor, m1, m2, m3 = tau2 == 0.0, 0, 0, 0.0, 0.0, 0.0
    halvings = 6 if natural else 12
    tolerance, patience = goal.tolerance, effort.patience if natural else CREEP
    while (
        (reached > tolerance or iteration < effort.least)
        and iteration < effort.most
        and poor < patience
        and (natural or tau2 > end)
    ):
        iteration += 1
        merit = _direction(n, nc, p, proximal, tau2)
        step, after = _line_search(nc, p, max(merit, m1, m2, m3), tau2, halvings)
        for i in range(nc):
            for k in range(3):
                p.r[i, k] += step * p.dr[i, k]
                p.u[i, k] += step * p.du[i, k]
        reached = residual(nc, p.mu, p.r, p.u, p.q, goal.scale)
        if reached <= tolerance:  # u has followed its steps: once more from the impulses, to the last digit
            finish(n, nc, p)
            reached = residual(nc, p.mu, p.r, p.u, p.q, goal.scale)
        m1, m2, m3 = merit, m1, m2
        if natural:
            poor = poor + 1 if after > POOR * merit else 0
        else:
            poor = poor + 1 if step < SHORT else 0
            if after <= 0.25 * tau2 * nc:
                tau2 *= SHRINK
                m1, m2, m3 = 0.0, 0.0, 0.0
    return iteration, reached if reached < np.inf else np.inf, tau2


@inner
def _direction(n, nc, p, proximal, tau2):
    """Write Newton's direction: impulses into dr, relative velocities into du; return the merit, the sum of squares."""
    start_system(n, p.K)
    add_bilateral(p.bilateral, p.K)
    for k in range(n):
        p.dw[k] = 0.0
    merit = 0.0
    for i in range(nc):
        s, mu = p.scale[i], p.mu[i]
        r0, r1, r2 = s * p.r[i, 0], s * p.r[i, 1], s * p.r[i, 2]
        u0, u1, u2 = p.u[i, 0], p.u[i, 1], p.u[i, 2]
        if tau2 == 0.0:
            merit += natural_map(i, mu, r0, r1, r2, u0, u1, u2, p.A, p.Q, p.b)
        else:
            merit += fischer_burmeister(i, mu, r0, r1, r2, u0, u1, u2, tau2, p.A, p.Q, p.b)
        eliminate(i, s, proximal, p.A, p.Q, p.b)
        add_impulse(p.rows, i, -p.b[i, 0], -p.b[i, 1], -p.b[i, 2], p.dw)
    add_blocks(nc, p.rows, p.mu, p.A, p.block, p.K)
    factorise(n, p.K)
    substitute(n, p.K, p.dw)
    for i in range(nc):
        d0, d1, d2 = relative(p.rows, i, p.dw)
        p.du[i, 0], p.du[i, 1], p.du[i, 2] = d0, d1, d2
        for k in range(3):
            p.dr[i, k] = -p.b[i, k] - (p.A[i, k, 0] * d0 + p.A[i, k, 1] * d1 + p.A[i, k, 2] * d2)
    return merit


@inner
def _line_search(nc, p, merit, tau2, halvings):
    """Halve the step until the merit falls below the given one; return the step and the merit there."""
    step, after = 1.0, np.inf
    for _ in range(halvings):
        after = 0.0
        for i in range(nc):
            s = p.scale[i]
            after += mismatch(
                p.mu[i],
                s * (p.r[i, 0] + step * p.dr[i, 0]),
                s * (p.r[i, 1] + step * p.dr[i, 1]),
                s * (p.r[i, 2] + step * p.dr[i, 2]),
                p.u[i, 0] + step * p.du[i, 0],
                p.u[i, 1] + step * p.du[i, 1],
                p.u[i, 2] + step * p.du[i, 2],
                tau2,
            )
        if after <= (1 - 1e-2 * step) * merit:
            break
        step *= 0.5
    return step, after
