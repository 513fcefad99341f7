"""Position stage: remove what is left of penetration, in the metric of the mass matrix (eq. 21, multipliers delta).

Minimise 1/2 d' M d subject to g_N + G_N d >= 0 over the contacts near the violation: a friction problem with mu = 0
whose velocity is a displacement. The metric matters: unweighted coordinates diverge on closed loops with clearance.
"""

from engine.kernels.contacts import add_whitened, whitened_rows
from engine.kernels.jit import kernel
from engine.kernels.rotations import rotation_matrix, turn

ROUNDS = 20
REACH = 2.0  # contacts open by less than this many times the violation take part
TOLERANCE = 1e-4  # of a displacement problem: the next round removes what is left


@kernel
def worst_penetration(gap):
    """Return the largest penetration (>= 0, NaN if any gap is) and its contact."""
    worst, where = 0.0, -1
    for i in range(gap.shape[0]):
        if not -gap[i] <= worst:  # a NaN is the worst of all
            worst, where = -gap[i], i
    return worst, where


@kernel
def gather_projection(bodies, contacts, state, work, worst, problem):
    """Write the displacement problem of the contacts near the violation; return their number."""
    n = 0
    for i in range(state.gap.shape[0]):
        if state.gap[i] <= REACH * worst:
            whitened_rows(
                bodies, state.x, state.R, contacts.a[i], contacts.b[i], work.point, work.frame, i, problem.rows, n
            )  # fmt: skip
            problem.mu[n] = 0.0
            for k in range(3):
                problem.q[n, k] = 0.0
                problem.r[n, k] = 0.0
            problem.q[n, 0] = state.gap[i]
            if state.gap[i] < 0.0:  # a guess: each contact repairs its own violation
                problem.r[n, 0] = -state.gap[i] / normal_delassus(problem.rows, n)
            n += 1
    return n


@kernel
def normal_delassus(rows, j):
    """Return the normal entry of contact j's Delassus block."""
    s = 0.0
    for a in range(rows.width[j, 0] + rows.width[j, 1]):
        s += rows.G[j, 0, a] * rows.G[j, 0, a]
    return s


@kernel
def displace(bodies, state, work, w):
    """Move every body by the whitened displacement w."""
    d = work.free
    for body in range(bodies.mass.shape[0]):
        for k in range(6):
            d[body, k] = 0.0
    add_whitened(bodies, w, d)
    for body in range(bodies.mass.shape[0]):
        for k in range(3):
            state.x[body, k] += d[body, k]
        turn(state.p[body], d[body, 3], d[body, 4], d[body, 5])
        rotation_matrix(state.p[body], state.R[body])
