"""Solve a friction problem: a fast method from the last solution, then robust methods from zero impulses.

All methods work in units in which the Delassus scales of the contacts are nearly equal.

Coulomb's law holds in any unit: with rows d_i G_i and velocities d_i q_i the impulses are r_i / d_i. Where a light
body and a heavy one touch other bodies, the Delassus scales s_i = |G_i|^2 / 3 of their contacts differ as their
masses do, and so does the significance of one unit of velocity. With d_i = (s / s_i)^(1/2), s the mean, speeds are
weighted as in the kinetic energy, and smoothing and line search treat all contacts alike. The factors are powers of
two, which change no digit.

1. From given impulses: Newton's method on the natural map, which takes one or two steps if the impulses are those of
   the previous time step; then the interior-point method, which approaches the solution from inside the cones.
2. From zero impulses: Newton's method on the smoothed equations with decreasing smoothing. Whenever the smoothing has
   become small, the natural map is tried from there, which takes three steps where further smoothing takes ten.
3. The interior-point method at a careful pace and with patience: it solves nine out of ten problems on which both
   others have failed.
4. Gauss-Seidel sweeps over the contacts, and the natural map from there: heaps of rolling balls.
5. Both of 2 and 3 with other starting points and other weights of impulses against velocities, relative to the Delassus
   scale; at last sweeps again, from the best impulses found, so that what is not solved is at least nearly so.

Coulomb's problem is not convex, and the weight that leads past a fold of the smoothed solutions is not known
beforehand. The attempts and their order are those that solved the most of 16,000 problems made to be hard, in the
fewest steps. A smoothed attempt that makes slow progress is abandoned early, because the next attempt costs less than
waiting; all attempts share a budget.
"""

import math

import numpy as np

from engine.friction.arrays import CONVERGED, NOT_CONVERGED, Effort, Goal, copy, finish, give_contacts, take_contacts
from engine.friction.blocks import BODY, ROW
from engine.friction.complementarity import residual
from engine.friction.gauss_seidel import gauss_seidel
from engine.friction.interior import BOLD, Pace, interior_point
from engine.friction.newton import newton
from engine.jit import inner, kernel
from engine.jit.lanes import read, write

NATURAL_STEPS = 30
PROXIMAL_GIVEN = 0.1  # share of the residual: near a solution the proximal term keeps the impulses in place
NATURAL_PATIENCE = 5  # from the previous step's impulses; after smoothing, the first poor step ends the method
INTERIOR_PATIENCE = 8  # after the interior-point method from zero impulses
INSIDE_GIVEN = 0.01  # share of the load: distance inside the cones at which the interior-point method starts
INTERIOR_STEPS, INTERIOR_STALL = 160, 80  # from zero impulses, patience and caution pay off
CAUTION, REACH = 0.6, 0.9
INTERIOR_STEPS_GIVEN, INTERIOR_STALL_GIVEN = 60, 12
SWEEPS, LAST_SWEEPS = 100, 300
# The nine attempts from zero impulses, one column each: numbers and order are those that solved most of 16,000 hard
# problems, not theory. The first two failed on 1,454 of them, of which the third solved 92 %. The last six vary these
# three, because it cannot be known beforehand which of them will lead past a fold.
# Two more are Gauss-Seidel sweeps: before the costly ones, and at last.
# RISE: of the interior-point method, see `Pace`; 0: smoothed equations; below 0: Gauss-Seidel sweeps
# BEGINNING: its distance inside the cones at the start, or the initial smoothing, as a share of the load
# WEIGHT: of impulses against velocities, as a multiple of the contact's Delassus scale
RISE = (0.0, 0.0, -1.0, 0.1, 0.0, 0.0, 0.0, 0.02, 0.0, 0.1, -1.0)
BEGINNING = (1e-2, 1e-4, 0.0, 1.0, 1e-4, 1e-4, 1e-4, 1e-2, 1e-1, 1e-1, 0.0)
WEIGHT = (0.3, 0.1, 1.0, 10.0, 0.03, 0.003, 1.0, 1.0, 0.03, 1.0, 1.0)
SMOOTHED_STEPS = 80
BUDGET = 80_000  # steps times (contacts + 30 for the system): 8 to 10 ms; an interior-point step counts twice
LEAST_BUDGET = 200  # steps, of hundreds of contacts
NEAR = 1e-8  # of the load squared: tau^2 at which the natural map is first tried; FALL is the factor to the next try
FALL = 1e-2
SMALLEST = 1e-30  # of the load squared: tau^2 below which the natural map is tried for the last time


@kernel
def solve_friction(nc, p, tolerance):
    """Solve the first ``nc`` contacts of ``p`` from the impulses in ``p.r``; return status, total steps and residual.

    On return ``p.r``, ``p.u`` and ``p.w`` hold the solution. If no method reaches ``tolerance``, a relative residual
    (`complementarity.residual`), the status is NOT_CONVERGED and they hold the impulses with the smallest residual: of
    those given, too.
    """
    goal, c = Goal(tolerance, take_contacts(nc, p)), p.contacts
    even_out(nc, p, goal.scale)
    load, warm = 0.0, False
    for i in range(nc):
        load += c.q[0, i] * c.q[0, i] + c.q[1, i] * c.q[1, i] + c.q[2, i] * c.q[2, i]
        warm = warm or c.r[0, i] != 0.0
    load /= max(nc, 1)
    warm = warm and load > 0.0  # without any velocity no impulse is the answer, which those given only approach
    if warm:
        copy(c.r, c.given)
    budget, total, best, weight, last = max(LEAST_BUDGET, BUDGET // (nc + 30)), 0, np.inf, 1.0, len(WEIGHT) - 1
    attempt = -2 if warm else 0  # -2, -1: natural map and interior point from given impulses
    while True:
        given = attempt < 0
        asked = 1.0 if given else WEIGHT[attempt]
        rise = 0.0 if given else RISE[attempt]
        sweeping, interior = rise < 0.0, attempt == -1 or rise > 0.0
        # all methods compare s r with u, so the weight is a factor of the scales s; it is taken out again at the end
        for i in range(nc):
            c.scale[i] *= asked / weight
            if not (given or attempt == last):
                c.r[0, i], c.r[1, i], c.r[2, i] = 0.0, 0.0, 0.0
        weight, limit, patience, least = asked, NATURAL_STEPS, NATURAL_PATIENCE, 0
        smoothing, before = 0.0 if given or interior or sweeping else BEGINNING[attempt], np.inf
        if interior:
            inside, pace = (INSIDE_GIVEN, BOLD) if given else (BEGINNING[attempt], Pace(0.0, rise, CAUTION, REACH))
            most, stall = (INTERIOR_STEPS_GIVEN, INTERIOR_STALL_GIVEN) if given else (INTERIOR_STEPS, INTERIOR_STALL)
            spent, before = interior_point(nc, p, goal, inside, pace, Effort(0, min(most, (budget + 1) // 2), stall))
            total += spent
            budget -= 2 * spent
            least, patience = 1, NATURAL_PATIENCE if given else INTERIOR_PATIENCE
        elif sweeping:
            if attempt == last:
                copy(c.kept, c.r)
            before = gauss_seidel(nc, p, goal, LAST_SWEEPS if attempt == last else SWEEPS)
            patience = INTERIOR_PATIENCE
            if before < best:
                best = before
                copy(c.r, c.kept)
        elif not given:
            limit, patience = min(SMOOTHED_STEPS, budget), 1
        tau2, proximal = smoothing * smoothing * load, PROXIMAL_GIVEN if given else 0.0
        spent, reached = _follow(nc, p, goal, tau2, load, proximal, before, Effort(least, limit, patience))
        total += spent
        budget -= spent
        if reached < best:
            best = reached
            copy(c.r, c.kept)
        if best <= tolerance or load == 0.0 or attempt == last:
            break
        attempt = attempt + 1 if budget > 0 else last
    if not best <= tolerance:
        if warm:
            copy(c.given, c.r)
            finish(nc, p)
            reached = residual(c, goal.scale, 1.0)
        if warm and reached < best:
            best = reached
        else:
            copy(c.kept, c.r)
            finish(nc, p)
    for i in range(nc):
        c.scale[i] /= weight
    restore(nc, p)
    give_contacts(nc, p)
    return CONVERGED if best <= tolerance else NOT_CONVERGED, total, best


@inner
def _follow(nc, p, goal, tau2, load, proximal, before, effort):
    """Follow the smoothed solutions down from tau^2 and try the natural map from each; return steps and residual.

    A solution from another method gets at least one step on the natural map, which reduces a residual just below the
    tolerance to rounding errors: the error of the forces is the residual divided by the compliance.
    """
    c, unknowns = p.contacts, BODY * p.system.begin.shape[0]
    copy(c.r, c.base)
    tolerance, least, limit, patience = goal.tolerance, effort.least, effort.most, effort.patience
    # from zero impulses the natural map is tried first only if they are hardly redundant; otherwise it fails
    natural = tau2 == 0.0 or 3 * nc <= unknowns
    spent, end, stuck = 0, min(NEAR * load, 0.5 * tau2), False
    while True:
        smoothed = 0.0 if natural else tau2  # a single call for both, because a kernel called twice is compiled twice
        most = NATURAL_STEPS if natural else limit - spent
        steps, reached, smoothed = newton(nc, p, goal, smoothed, end, proximal, Effort(least, most, patience))
        if not natural:
            tau2, stuck = smoothed, smoothed > end
        spent += steps
        if natural and before <= tolerance and not reached < before:
            copy(c.base, c.r)
            finish(nc, p)
            return spent, before
        if natural and (reached <= tolerance or tau2 == 0.0 or stuck or spent >= limit or end < SMALLEST * load):
            return spent, reached
        before, least, patience = reached, int(not natural), 1
        if natural:
            copy(c.base, c.r)
        else:
            copy(c.r, c.base)
            end *= FALL
        natural = not natural


@inner
def even_out(nc, p, mean):
    """Give each contact the unit in which its Delassus scale is nearly ``mean``; `restore` undoes it.

    The rows of p and the lanes of its contacts are changed.
    """
    c = p.contacts
    for i in range(c.unit.shape[0]):
        c.unit[i] = 1.0
    for i in range(nc):
        share = mean / c.scale[i]
        if 0.5 <= share <= 2.0 or not 1e-200 < share < 1e200:
            continue
        _, exponent = math.frexp(share)
        unit = math.ldexp(1.0, exponent >> 1)
        c.unit[i] = unit
        c.scale[i] *= unit * unit
        c.compliance[i] *= unit * unit
        for k in range(3):
            c.q[k, i] *= unit
            c.r[k, i] /= unit
        _multiply(p.rows, i, unit)


@inner
def restore(nc, p):
    """Undo `even_out`."""
    c = p.contacts
    for i in range(nc):
        unit = c.unit[i]
        if unit != 1.0:
            c.scale[i] /= unit * unit
            c.compliance[i] /= unit * unit
            for k in range(3):
                c.q[k, i] /= unit
                c.r[k, i] *= unit
                c.u[k, i] /= unit
            _multiply(p.rows, i, 1 / unit)
            c.unit[i] = 1.0


@inner
def _multiply(rows, i, factor):
    """Multiply the rows of contact i."""
    for k in range(3):
        for s in range(rows.node.shape[1]):
            write(factor * read(rows.G[i, k], ROW * s), rows.G[i, k], ROW * s)
