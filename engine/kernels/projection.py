"""Position stage: remove what is left of penetration, in the metric of the mass matrix (eq. 21, multipliers delta).

Minimise 1/2 d' M d subject to g_N + G_N d >= 0 over the contacts near the violation; linearise again until the largest
violation is below the tolerance. The metric matters: unweighted coordinates diverge on closed loops with clearance.
"""

from engine.friction.arrays import CONVERGED
from engine.friction.solver import solve_friction
from engine.kernels.contacts import add_whitened, find_contacts, whitened_rows
from engine.kernels.jit import kernel
from engine.kernels.rotations import rotation_matrix, turn

ROUNDS = 20
REACH = 10.0  # contacts open by less than this many times the violation take part


@kernel
def project_positions(model, state, work, problem, tolerance):
    """Move the bodies out of penetration; ``state.gap`` is current on return.

    Returns
    -------
    worst : the largest penetration left (>= 0), below ``tolerance`` if the projection worked
    contact : where
    """
    worst, where = 0.0, -1
    for _ in range(ROUNDS):
        find_contacts(model, state, state.gap, work.point, work.frame)
        worst, where = 0.0, -1
        for i in range(state.gap.shape[0]):
            if not -state.gap[i] <= worst:  # a NaN is the worst of all
                worst, where = -state.gap[i], i
        if worst <= 0.5 * tolerance or not worst < 1e300:
            break
        n = 0
        for i in range(state.gap.shape[0]):
            if state.gap[i] <= REACH * worst:
                problem.count[n] = whitened_rows(
                    model, state, i, work.point[i], work.frame[i], problem.column[n], problem.G[n]
                )
                problem.mu[n] = 0.0
                for k in range(3):
                    problem.q[n, k] = 0.0
                    problem.r[n, k] = 0.0
                problem.q[n, 0] = state.gap[i]
                n += 1
        status, _, _ = solve_friction(6 * model.mass.shape[0], n, problem, 1e-8)
        if status != CONVERGED:
            break
        _displace(model, state, work, problem.w)
    return worst, where


@kernel
def _displace(model, state, work, w):
    """Move every body by the whitened displacement w."""
    d = work.free
    d[:] = 0.0
    add_whitened(model, w, d)
    for body in range(model.mass.shape[0]):
        for k in range(3):
            state.x[body, k] += d[body, k]
        turn(state.p[body], d[body, 3], d[body, 4], d[body, 5])
        rotation_matrix(state.p[body], state.R[body])
