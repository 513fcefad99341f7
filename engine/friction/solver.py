"""The order in which the methods are tried: a quick one from the last solution, a sure one, a surer one."""

import numpy as np

from engine.friction.arrays import CONVERGED, NOT_CONVERGED, finish, measure_scales
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
    mean = measure_scales(nc, p)
    warm = False
    for i in range(nc):
        warm = warm or p.r[i, 0] != 0.0
    total, best = newton(n, nc, p, mean, tolerance, 1e-5 if warm else 1e-2, NEWTON_STEPS)
    if best <= tolerance:
        return CONVERGED, total, best
    p.start[:nc] = p.r[:nc]
    spent, reached = interior_point(n, nc, p, mean, tolerance, True, INTERIOR_STEPS)
    total += spent
    spent, reached = _polish(n, nc, p, mean, tolerance, reached)
    total += spent
    if reached < best:
        best = reached
        p.start[:nc] = p.r[:nc]
    for smoothing in (1e-2, 1.0):
        if best <= tolerance:
            return CONVERGED, total, best
        p.r[:nc] = 0.0
        spent, reached = newton(n, nc, p, mean, tolerance, smoothing, 4 * NEWTON_STEPS)
        total += spent
        if reached < best:
            best = reached
            p.start[:nc] = p.r[:nc]
    spent, best = _iterate_shift(n, nc, p, mean, tolerance, best)
    total += spent
    p.r[:nc] = p.start[:nc]
    finish(nc, p)
    return CONVERGED if best <= tolerance else NOT_CONVERGED, total, best


@kernel
def _polish(n, nc, p, mean, tolerance, reached):
    """Newton from a point near the solution, with more and more smoothing; keeps the better impulses."""
    total = 0
    for smoothing in (1e-9, 1e-6, 1e-3):
        if reached <= tolerance:
            break
        p.best[:nc] = p.r[:nc]
        spent, after = newton(n, nc, p, mean, tolerance, smoothing, NEWTON_STEPS)
        total += spent
        if after < reached:
            reached = after
        else:
            p.r[:nc] = p.best[:nc]
    return total, reached


@kernel
def _iterate_shift(n, nc, p, mean, tolerance, best):
    """Solve convex problems with a given shift s_i = mu_i |u_T,i| until the shift is that of their solution.

    The fixed point behind the existence theory of Coulomb's problem; each convex problem is sure to be solved.
    The best impulses are kept in ``p.start``; returns the steps spent and the residual reached.
    """
    total = 0
    for i in range(nc):
        p.q0[i] = p.q[i, 0]
    for _ in range(SHIFTS):
        if best <= tolerance:
            break
        spent, _ = interior_point(n, nc, p, mean, 0.1 * tolerance, False, INTERIOR_STEPS)
        total += spent
        for i in range(nc):
            p.q[i, 0] = p.q0[i] + p.mu[i] * np.sqrt(p.u[i, 1] ** 2 + p.u[i, 2] ** 2)
            p.y[i, 0] = p.q[i, 0]
        for i in range(nc):
            p.q[i, 0] = p.q0[i]
        spent, reached = newton(n, nc, p, mean, tolerance, 1e-9, NEWTON_STEPS)
        total += spent
        if reached < best:
            best = reached
            p.start[:nc] = p.r[:nc]
        for i in range(nc):
            p.q[i, 0] = p.y[i, 0]
    for i in range(nc):
        p.q[i, 0] = p.q0[i]
    return total, best
