"""Newton's method on the equations of the contacts, with each contact eliminated.

The equation of each contact is linearised and solved for its impulse (`complementarity`), which leaves one system in
the velocities alone, (B + sum_i G_i' A_i G_i) dw = -sum_i G_i' b_i. It has as many unknowns as the mechanism has
degrees of freedom, however many contacts there are and however redundant they are.
"""

import numpy as np

from engine.friction.arrays import add_impulse, all_relative, finish
from engine.friction.bilateral import add_bilateral
from engine.friction.blocks import add_contact, clear, factorise, start_system, substitute
from engine.friction.complementarity import (
    eliminate,
    fischer_burmeister,
    natural_map,
    natural_mismatch,
    read_matrix,
    residual,
    smoothed_mismatch,
)
from engine.jit import inner
from engine.jit.lanes import LANES, choose, read, spread, total, write

SHRINK = 0.04  # factor of tau^2 once the smoothed equation is solved accurately enough for its smoothing
POOR = 0.5  # a step on the natural map is poor if it leaves more than this share of the merit
SHORT = 0.1  # a step on the smoothed equation is poor if it is shorter than this share of Newton's step
LEAST_PROXIMAL = 1e-8  # share of a sticking contact's velocity in its equation; makes the impulse unique
LARGEST_PROXIMAL = 1e-2
CREEP = 6  # number of consecutive poor steps after which the smoothed equation is abandoned


@inner
def newton(nc, p, goal, tau2, end, proximal, effort):
    """Improve the impulses by Newton's method; return the number of steps, the residual reached and tau^2.

    If ``tau2`` is 0, the equation is the natural map. The line search is not monotone: a step may raise the merit above
    the current one, but not above the largest of the last four; the method is abandoned after ``patience`` consecutive
    poor steps. Otherwise the equation is the Fischer-Burmeister function, with the smoothing reduced until tau^2 is
    below ``end``, so that a wrong guess of which contacts open, slide and stick is corrected early instead of being
    kept; after ``CREEP`` consecutive poor steps the method is abandoned with tau^2 above ``end``.

    ``proximal`` is the proximal term of the contacts (`complementarity.eliminate`) as a share of the residual. Far from
    the solution it keeps impulses that the velocities do not determine at their values.
    """
    c = p.contacts
    finish(nc, p)
    reached = residual(c, goal.scale, 1.0)
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
        term = min(max(proximal * reached, LEAST_PROXIMAL), LARGEST_PROXIMAL)
        merit = _direction(nc, p, term, tau2)
        step, after = _line_search(c, max(merit, m1, m2, m3), tau2, halvings)
        for k in range(3):
            for i in range(0, nc, LANES):
                write(read(c.r[k], i) + step * read(c.dr[k], i), c.r[k], i)
                write(read(c.u[k], i) + step * read(c.du[k], i), c.u[k], i)
        reached = residual(c, goal.scale, 1.0)
        if reached <= tolerance:  # u was updated incrementally: recompute it from the impulses, to the last digit
            finish(nc, p)
            reached = residual(c, goal.scale, 1.0)
        m1, m2, m3 = merit, m1, m2
        if natural:
            poor = poor + 1 if after > POOR * merit else 0
        else:
            poor = poor + 1 if step < SHORT else 0
            if after <= 0.25 * tau2 * nc:
                tau2 *= SHRINK
                m1, m2, m3 = 0.0, 0.0, 0.0  # merits of another equation, which say nothing about this one
    return iteration, reached if reached < np.inf else np.inf, tau2


@inner
def _direction(nc, p, proximal, tau2):
    """Write Newton's direction: impulses into dr, relative velocities into du; return the merit, the sum of squares."""
    merit = _linearise(p.contacts, proximal, tau2)
    c, A, b = p.contacts, p.contacts.A, p.contacts.b
    start_system(p.system, p.K)
    add_bilateral(p.bilateral, p.K)
    clear(p.dw)
    for i in range(nc):
        add_impulse(p.rows, i, -b[0, i], -b[1, i], -b[2, i], p.dw)
        if A[0, i] != 0.0:  # an open contact has no block
            add_contact(p.rows, i, A, p.mu[i] == 0.0, p.K)
    factorise(p.system, p.K, p.F)
    substitute(p.system, p.K, p.F, p.dw)
    all_relative(nc, p.rows, p.dw, c.du)
    for i in range(0, nc, LANES):
        a00, a01, a02, a10, a11, a12, a20, a21, a22 = read_matrix(A, i)
        d0, d1, d2, give = read(c.du[0], i), read(c.du[1], i), read(c.du[2], i), read(c.compliance, i)
        there = read(c.present, i) > 0.0
        r0 = choose(there, -(read(b[0], i) + a00 * d0 + a01 * d1 + a02 * d2), 0.0)
        r1 = choose(there, -(read(b[1], i) + a10 * d0 + a11 * d1 + a12 * d2), 0.0)
        r2 = choose(there, -(read(b[2], i) + a20 * d0 + a21 * d1 + a22 * d2), 0.0)
        write(r0, c.dr[0], i)
        write(r1, c.dr[1], i)
        write(r2, c.dr[2], i)
        write(d0 + give * r0, c.du[0], i)
        write(d1 + give * r1, c.du[1], i)
        write(d2 + give * r2, c.du[2], i)
    return merit


@inner
def _linearise(c, proximal, tau2):
    """Write the eliminated equations of the contacts into A and b; return the sum of squares of the equations."""
    merit = spread(0.0)
    for i in range(0, c.mu.shape[0], LANES):
        s, mu, there = read(c.scale, i), read(c.mu, i), read(c.present, i) > 0.0
        r0, r1, r2 = s * read(c.r[0], i), s * read(c.r[1], i), s * read(c.r[2], i)
        u0, u1, u2 = read(c.u[0], i), read(c.u[1], i), read(c.u[2], i)
        if tau2 == 0.0:
            square = natural_map(i, mu, r0, r1, r2, u0, u1, u2, c.A, c.Q, c.b)
        else:
            square = fischer_burmeister(i, mu, r0, r1, r2, u0, u1, u2, tau2, c.A, c.Q, c.b)
        merit += choose(there, square, 0.0)
        give = read(c.compliance, i)
        eliminate(i, s, choose(give > 0.0, give / s, proximal), c.A, c.Q, c.b)
    return total(merit)


@inner
def _line_search(c, merit, tau2, halvings):
    """Halve the step until the merit falls below the given one; return the step and its merit."""
    step, after = 1.0, np.inf
    for _ in range(halvings):
        after = total(_merit(c, step, tau2))
        if after <= (1 - 1e-2 * step) * merit:
            break
        step *= 0.5
    return step, after


@inner
def _merit(c, step, tau2):
    """Return the sum of squares of the equations after a step, as eight partial sums."""
    merit = spread(0.0)
    for i in range(0, c.mu.shape[0], LANES):
        s, mu, there = read(c.scale, i), read(c.mu, i), read(c.present, i) > 0.0
        r0 = s * (read(c.r[0], i) + step * read(c.dr[0], i))
        r1 = s * (read(c.r[1], i) + step * read(c.dr[1], i))
        r2 = s * (read(c.r[2], i) + step * read(c.dr[2], i))
        u0 = read(c.u[0], i) + step * read(c.du[0], i)
        u1 = read(c.u[1], i) + step * read(c.du[1], i)
        u2 = read(c.u[2], i) + step * read(c.du[2], i)
        if tau2 == 0.0:
            square = natural_mismatch(mu, r0, r1, r2, u0, u1, u2)
        else:
            square = smoothed_mismatch(mu, r0, r1, r2, u0, u1, u2, tau2)
        merit += choose(there, square, 0.0)
    return merit
