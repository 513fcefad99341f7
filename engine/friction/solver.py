"""Solve a friction problem: a quick method from the last solution, then robust methods from zero impulses.

1. With impulses given: Newton on the natural map from there, one or two steps when they are those of the step before;
   then the interior-point method, which sees the problem from inside the cones.
2. From zero impulses: Newton on the smoothed equations, less and less smoothed; whenever the smoothing has become
   small, the natural map is tried from there, which needs three steps where further smoothing needs ten.
3. The same with other smoothing and other weights of impulses against velocities, times the Delassus scale; the
   interior-point method at last.

Coulomb's problem is not convex, and which weight leads past a fold of the smoothed solutions is not known beforehand.
An attempt that creeps is given up early, as the next one costs less than patience would; all share a budget.
"""

import numpy as np

from engine.friction.arrays import CONVERGED, NOT_CONVERGED, Effort, Goal, copy, finish, measure_scales
from engine.friction.interior import interior_point
from engine.friction.newton import newton
from engine.jit import inner, kernel

NATURAL_STEPS = 30
PROXIMAL = 1e-8  # share of a sticking contact's velocity in its equation, which makes its impulse unique
PROXIMAL_GIVEN = 1e-4  # near a solution a larger share keeps the impulses where they are
NATURAL_PATIENCE = 5  # with the impulses of the step before; elsewhere the first poor step ends the method
INTERIOR_STEPS = 60
INSIDE = 0.1  # share of the load: how far inside the cones the interior-point method starts
# of each attempt from zero impulses: its first smoothing as a share of the load, and the weight of impulses
SMOOTHING = (1e-2, 1e-4, 1e-1, 1e-4, 1e-2, 1e-4, 1e-4, 1.0, 1e-3, 1e-1, 1e-3, 10.0, 1e-3, 1e-1)
WEIGHT = (1.0, 0.03, 0.01, 0.1, 0.3, 0.003, 1e-4, 0.3, 1.0, 0.1, 0.03, 1.0, 0.003, 1e-3)
SMOOTHED_STEPS = 80
BUDGET = 36_000  # steps times contacts, and 30 more for the system: 15 ms or so; an interior-point step counts twice
LEAST_BUDGET = 240  # steps
NEAR = 1e-8  # of the load squared: tau^2 at which the natural map is tried first, then after each fall by FALL
FALL = 1e-2
SMALLEST = 1e-30


@kernel
def solve_friction(n, nc, p, tolerance):
    """Solve the first ``nc`` contacts of the problem ``p`` from the impulses in ``p.r``.

    If no method reaches ``tolerance``, the impulses of the smallest residual are left in ``p.r``.

    Parameters
    ----------
    n, nc : int
        Numbers of unknowns and contacts.
    p : FrictionArrays
        ``r``, ``u`` and ``w`` hold the solution on return.
    tolerance : float
        Relative residual to reach, see `cone.residual`.

    Returns
    -------
    status : int
        CONVERGED or NOT_CONVERGED.
    iterations : int
        Steps of all attempts together.
    residual : float
        Relative residual reached.
    """
    goal = Goal(tolerance, measure_scales(nc, p.rows, p.scale))
    load, warm = 0.0, False
    for i in range(nc):
        load += p.q[i, 0] * p.q[i, 0] + p.q[i, 1] * p.q[i, 1] + p.q[i, 2] * p.q[i, 2]
        warm = warm or p.r[i, 0] != 0.0
    load /= max(nc, 1)
    budget, total, best, weight, last = max(LEAST_BUDGET, BUDGET // (nc + 30)), 0, np.inf, 1.0, len(SMOOTHING)
    for attempt in range(-2 if warm else 0, last + 1):
        given = attempt < 0
        asked = WEIGHT[attempt] if 0 <= attempt < last else 1.0
        for i in range(nc):
            p.scale[i] *= asked / weight
            if not given:
                p.r[i, 0], p.r[i, 1], p.r[i, 2] = 0.0, 0.0, 0.0
        weight, smoothing, limit, patience, least = asked, 0.0, NATURAL_STEPS, NATURAL_PATIENCE, 0
        if attempt == -1 or attempt == last:
            spent, _ = interior_point(n, nc, p, goal, INSIDE, min(INTERIOR_STEPS, (budget + 1) // 2))
            total += spent
            budget -= 2 * spent
            least = 1
        elif not given:
            smoothing, limit, patience = SMOOTHING[attempt], min(SMOOTHED_STEPS, budget), 1
        tau2, proximal = smoothing * smoothing * load, PROXIMAL_GIVEN if given else PROXIMAL
        spent, reached = _follow(n, nc, p, goal, tau2, load, proximal, Effort(least, limit, patience))
        total += spent
        budget -= spent
        if reached < best:
            best = reached
            copy(nc, p.r, p.kept)
        if best <= tolerance or load == 0.0 or budget <= 0:
            break
    for i in range(nc):
        p.scale[i] /= weight
    if not best <= tolerance:
        copy(nc, p.kept, p.r)
        finish(n, nc, p)
    return CONVERGED if best <= tolerance else NOT_CONVERGED, total, best


@inner
def _follow(n, nc, p, goal, tau2, load, proximal, effort):
    """Follow the smoothed solutions down from tau^2, trying the natural map from each; return steps and residual.

    A solution of another method gets at least one step on the natural map, which brings a residual just below the
    tolerance down to the last digits: forces are as good as the residual divided by the compliance.
    """
    copy(nc, p.r, p.base)
    tolerance, least, limit, patience = goal.tolerance, effort.least, effort.most, effort.patience
    natural = tau2 == 0.0 or 3 * nc <= n  # from zero impulses only where these are hardly redundant: elsewhere it fails
    spent, end, before, stuck = 0, min(NEAR * load, 0.5 * tau2), np.inf, False
    while True:
        smoothed = 0.0 if natural else tau2  # one call for both: a kernel that is called twice is compiled twice
        most = NATURAL_STEPS if natural else limit - spent
        steps, reached, smoothed = newton(n, nc, p, goal, smoothed, end, proximal, Effort(least, most, patience))
        if not natural:
            tau2, stuck = smoothed, smoothed > end
        spent += steps
        if natural and before <= tolerance and not reached < before:
            copy(nc, p.base, p.r)
            finish(n, nc, p)
            return spent, before
        if natural and (reached <= tolerance or tau2 == 0.0 or stuck or spent >= limit or end < SMALLEST * load):
            return spent, reached
        before, least, patience = reached, int(not natural), 1
        if natural:
            copy(nc, p.base, p.r)
        else:
            copy(nc, p.r, p.base)
            end *= FALL
        natural = not natural
