"""The order in which the methods are tried: a quick one from the last solution, a sure one, a surer one.

1. Newton from the given impulses: one or two steps when they are those of the step before.
2. Interior point from where Newton creeps, then from far inside the cones; each time Newton from its end.
3. Convex problems with a given shift s_i = mu_i |u_T,i|, repeated until the shift is that of their solution, each
   followed by Newton: the fixed point behind the existence theory of Coulomb's problem.
"""

import numpy as np

from engine.friction.arrays import CONVERGED, NOT_CONVERGED, copy, finish, measure_scales
from engine.friction.interior import interior_point
from engine.friction.newton import newton
from engine.kernels.jit import kernel

FIRST_STEPS = 20
POLISH_STEPS = 30
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
    for i in range(nc):
        p.q0[i] = p.q[i, 0]
    total, best = 0, np.inf
    for attempt in range(3 + SHIFTS):
        if attempt > 0:
            spent, _ = interior_point(n, nc, p, mean, tolerance, attempt < 3, attempt == 1, INTERIOR_STEPS)
            total += spent
            for i in range(nc):  # the shift of this solution: given to the next attempt, not to Newton
                p.shift[i] = p.mu[i] * np.sqrt(p.u[i, 1] ** 2 + p.u[i, 2] ** 2)
                p.q[i, 0] = p.q0[i]
        spent, reached = newton(n, nc, p, mean, tolerance, FIRST_STEPS if attempt == 0 else POLISH_STEPS)
        total += spent
        if reached < best:
            best = reached
            copy(nc, p.r, p.kept)
        if best <= tolerance:
            break
        if attempt > 2:
            for i in range(nc):
                p.q[i, 0] = p.q0[i] + p.shift[i]
    for i in range(nc):
        p.q[i, 0] = p.q0[i]
    copy(nc, p.kept, p.r)
    finish(nc, p.rows, p.q, p.r, p.w, p.u)
    return CONVERGED if best <= tolerance else NOT_CONVERGED, total, best
