"""The order in which the methods are tried: a quick one from the last solution, sure ones from nothing.

1. Newton on the natural map from the given impulses: one or two steps when they are those of the step before.
2. Newton on the smoothed equations from nothing, less and less smoothed; whenever the smoothing has become small, the
   natural map is tried from there, which needs three steps where further smoothing needs ten.
3. Interior point, which sees the problem from inside the cones and solves what Newton does not.

With given impulses 2 is left out at first; then 2 and 3 go on in turn from other starts. Without a proof that Coulomb's
problem can be solved from any of them, many starts are what there is: one in a thousand needs more than two.
"""

import numpy as np

from engine.friction.arrays import CONVERGED, NOT_CONVERGED, copy, finish, measure_scales
from engine.friction.interior import interior_point
from engine.friction.newton import newton
from engine.kernels.jit import inner, kernel

NATURAL_STEPS = 30
PROXIMAL = 1e-8  # share of a sticking contact's velocity in its equation: what makes its impulse unique
PROXIMAL_GIVEN = 1e-4  # near a solution more of it keeps the impulses where they are
NATURAL_PATIENCE = 5  # with the impulses of the step before; elsewhere the first poor step ends it
INTERIOR_STEPS = 60
SMOOTHING = (1e-2, 1.0, 10.0, 0.1, 1e-3)  # of the load, at the start of each attempt
SMOOTHED_STEPS = (60, 100, 200, 200, 200)
INSIDE = (0.1, 10.0, 1.0, 1e-2, 100.0)  # of the load: how far inside the cones an interior-point attempt starts
NEAR = 1e-8  # of the load squared: tau^2 at which the natural map is tried, and again each time it fell by FALL
FALL = 1e-2
SMALLEST = 1e-30


@kernel
def solve_friction(n, nc, p, tolerance):
    """Solve the first ``nc`` contacts of the problem ``p`` from the impulses in ``p.r``.

    If no method reaches ``tolerance``, the impulses of the smallest residual are left in ``p.r``.

    Returns
    -------
    status : CONVERGED or NOT_CONVERGED
    iterations : steps of all attempts together
    reached : relative residual (see `cone.residual`)
    """
    mean = measure_scales(nc, p.rows, p.scale)
    load, warm = 0.0, False
    for i in range(nc):
        load += p.q[i, 0] * p.q[i, 0] + p.q[i, 1] * p.q[i, 1] + p.q[i, 2] * p.q[i, 2]
        warm = warm or p.r[i, 0] != 0.0
    load /= max(nc, 1)
    total, best = 0, np.inf
    for attempt in range(2 * len(SMOOTHING)):
        level, given = attempt // 2, warm and attempt < 2
        if attempt > 0 and not given:
            for i in range(nc):
                p.r[i, 0], p.r[i, 1], p.r[i, 2] = 0.0, 0.0, 0.0
        smoothing, limit, patience = 0.0, NATURAL_STEPS, NATURAL_PATIENCE
        if attempt % 2 == 1:
            spent, _ = interior_point(n, nc, p, mean, tolerance, INSIDE[level], INTERIOR_STEPS)
            total += spent
        elif not given:
            smoothing, limit, patience = SMOOTHING[level], SMOOTHED_STEPS[level], 1
        tau2, least, proximal = smoothing * smoothing * load, attempt % 2, PROXIMAL_GIVEN if given else PROXIMAL
        spent, reached = _follow(n, nc, p, mean, tolerance, tau2, load, proximal, least, limit, patience)
        total += spent
        if reached < best:
            best = reached
            copy(nc, p.r, p.kept)
        if best <= tolerance or load == 0.0:
            break
    if not best <= tolerance:
        copy(nc, p.kept, p.r)
        finish(n, nc, p)
    return CONVERGED if best <= tolerance else NOT_CONVERGED, total, best


@inner
def _follow(n, nc, p, mean, tolerance, tau2, load, proximal, least, limit, patience):
    """Follow the smoothed solutions down from tau^2, from each try the natural map; return steps and residual.

    A solution that comes from elsewhere than the natural map gets ``least`` one step of it, which makes of a residual
    just below the tolerance one of the last digits: forces are as good as the residual over the compliance.
    """
    copy(nc, p.r, p.base)
    natural = tau2 == 0.0 or 3 * nc <= n  # from nothing only where impulses are hardly redundant: elsewhere it fails
    spent, end, before = 0, NEAR * load, np.inf
    while True:
        smoothed = 0.0 if natural else tau2  # one call for both: what is called twice is compiled twice
        most = NATURAL_STEPS if natural else limit - spent
        steps, reached, smoothed = newton(n, nc, p, mean, tolerance, smoothed, end, proximal, least, most, patience)
        tau2 = tau2 if natural else smoothed
        spent += steps
        if natural and before <= tolerance and not reached < before:
            copy(nc, p.base, p.r)
            finish(n, nc, p)
            return spent, before
        if natural and (reached <= tolerance or tau2 == 0.0 or spent >= limit or end < SMALLEST * load):
            return spent, reached
        before, least, patience = reached, int(not natural), 1
        if natural:
            copy(nc, p.base, p.r)
        else:
            copy(nc, p.r, p.base)
            end *= FALL
        natural = not natural
