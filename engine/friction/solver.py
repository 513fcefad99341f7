"""The order in which the methods are tried: a quick one from the last solution, a sure one, a surer one.

1. Newton from the given impulses: one or two steps when they are those of the step before.
2. Interior point, then Newton from there: most problems on which Newton creeps.
3. Newton from zero with more and more smoothing.
4. Convex problems with a given shift s_i = mu_i |u_T,i|, repeated until the shift is that of their solution, each followed
   by Newton: the fixed point behind the existence theory of Coulomb's problem.
"""

import numpy as np

from engine.friction.arrays import CONVERGED, NOT_CONVERGED, copy, finish, measure_scales
from engine.friction.interior import interior_point
from engine.friction.newton import newton
from engine.kernels.jit import kernel

NEWTON_STEPS = 30
INTERIOR_STEPS = 60
SHIFTS = 40


@kernel
def solve_friction(n, nc, p, tolerance):
    """Solve the first ``nc`` contacts of the problem ``p`` from the impulses in ``p.r``.

    If no method reaches ``tolerance``, the impulses of the smallest residual are left in ``p.r``.

    Returns
    -------
    status : CONVERGED or NOT_CONVERGED
    iterations : steps of all methods together
    reached : relative residual (see `cone.residual`)
    """
    mean = measure_scales(nc, p.rows, p.scale)
    warm = False
    for i in range(nc):
        warm = warm or p.r[i, 0] != 0.0
        p.q0[i] = p.q[i, 0]
    total, best = 0, np.inf
    for attempt in range(6 + SHIFTS):
        inside, coupled, smoothing, limit = _plan(attempt, warm)
        if inside:
            spent, reached = interior_point(n, nc, p, mean, tolerance, coupled, INTERIOR_STEPS)
            total += spent
            for i in range(nc):  # the shift of this solution: given in the next round, part of the problem for Newton
                p.y[i, 0] = p.mu[i] * np.sqrt(p.u[i, 1] ** 2 + p.u[i, 2] ** 2)
                p.q[i, 0] = p.q0[i]
        elif smoothing >= 1e-2:
            for i in range(nc):
                p.r[i, 0], p.r[i, 1], p.r[i, 2] = 0.0, 0.0, 0.0
        spent, reached = newton(n, nc, p, mean, tolerance, smoothing, limit)
        total += spent
        if reached < best:
            best = reached
            copy(nc, p.r, p.kept)
        if best <= tolerance:
            break
        if attempt >= 5:
            for i in range(nc):
                p.q[i, 0] = p.q0[i] + (p.y[i, 0] if attempt > 5 else 0.0)
    for i in range(nc):
        p.q[i, 0] = p.q0[i]
    copy(nc, p.kept, p.r)
    finish(nc, p.rows, p.q, p.r, p.w, p.u)
    return CONVERGED if best <= tolerance else NOT_CONVERGED, total, best


@kernel
def _plan(attempt, warm):
    """Return for an attempt: interior point first? coupled? Newton's smoothing and limit of steps."""
    if attempt == 0:
        return False, True, 1e-5 if warm else 1e-2, NEWTON_STEPS
    if attempt == 1:
        return True, True, 1e-9, NEWTON_STEPS
    if attempt == 2:
        return False, True, 1e-6, NEWTON_STEPS
    if attempt == 3:
        return False, True, 1e-2, 4 * NEWTON_STEPS
    if attempt == 4:
        return False, True, 1.0, 4 * NEWTON_STEPS
    return True, False, 1e-9, NEWTON_STEPS
