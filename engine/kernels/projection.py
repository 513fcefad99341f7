"""Position stage: remove what is left of penetration and of joint violation, in the metric of the mass matrix (eq. 21).

Minimise 1/2 d' M d subject to g_N + G_N d >= 0 over the contacts near the violation and g_J + J d = 0 in the joints: a
friction problem with mu = 0 whose velocity is a displacement. The metric matters: unweighted coordinates diverge on
closed loops with clearance.
"""

from engine.friction.arrays import CONVERGED
from engine.friction.solver import solve_friction
from engine.friction.ties import hold_ties, tie_down
from engine.kernels.contacts import add_whitened, relative_velocity, whitened_rows
from engine.kernels.jit import kernel
from engine.kernels.rotations import rotation_matrix, turn
from engine.kernels.ties import tie_violations, whitened_ties
from engine.kernels.watch import look_within, spend

ROUNDS = 20
REACH = 2.0  # contacts open by less than this many times the violation take part
TOLERANCE = 1e-4  # of a displacement problem: the next round removes what is left


@kernel
def project_positions(bodies, contacts, ties, state, work, problem, penetration, violation):
    """Displace the bodies until no contact penetrates by half of ``penetration``, no joint is off by half its limit.

    Returns
    -------
    worst, where : largest penetration left, and its contact
    off : largest joint violation left
    """
    worst, where, off = 0.0, -1, 0.0
    for _ in range(ROUNDS):
        look_within(contacts, state.x, state.R, work, 0.0, state.gap)
        worst, where = largest_penetration(state.gap)
        tie_violations(ties, state.x, state.R, work.target[1], work.violation, work.tie_point, work.tie_way)
        off = largest_violation(work.violation)
        if (worst <= 0.5 * penetration and off <= 0.5 * violation) or not worst + off < 1e300:
            break
        look_within(contacts, state.x, state.R, work, REACH * max(worst, off), state.gap)
        displacement = work.free
        for body in range(displacement.shape[0]):
            for k in range(6):
                displacement[body, k] = 0.0
        if work.violation.shape[0] > 0:
            whitened_ties(bodies, ties, state.x, state.R, work.tie_point, work.tie_way, problem.ties.J)
            tie_down(problem.w.shape[0], problem.ties)
            hold_ties(problem.w.shape[0], problem.ties, work.violation, problem.w)
            add_whitened(bodies, problem.w, displacement)
        n = gather_projection(bodies, contacts, state, work, REACH * max(worst, off), problem)
        if n > 0:
            solved, _, _ = solve_friction(problem.w.shape[0], n, problem, TOLERANCE)
            if solved != CONVERGED:
                break
            add_whitened(bodies, problem.w, displacement)
        spend(contacts, state.x, displacement, 1.0, work.rate, work.lever, work.budget)
        displace(bodies, state, displacement)
    return worst, where, off


@kernel
def largest_penetration(gap):
    """Return the largest penetration (>= 0, NaN if any gap is) and its contact."""
    worst, where = 0.0, -1
    for i in range(gap.shape[0]):
        if not -gap[i] <= worst:  # a NaN is the worst of all
            worst, where = -gap[i], i
    return worst, where


@kernel
def largest_violation(violation):
    """Return the largest size of a joint violation, NaN if any is."""
    off = 0.0
    for i in range(violation.shape[0]):
        if not abs(violation[i]) <= off:
            off = abs(violation[i])
    return off


@kernel
def gather_projection(bodies, contacts, state, work, within, problem):
    """Write the displacement problem of the contacts open by no more than ``within``; return their number."""
    n = 0
    for i in range(state.gap.shape[0]):
        if state.gap[i] <= within:
            whitened_rows(
                bodies, state.x, state.R, contacts.a[i], contacts.b[i], work.point, work.frame, i, problem.rows, n
            )  # fmt: skip
            relative_velocity(
                state.x, state.R, contacts.a[i], contacts.b[i], work.point, work.frame, work.free, i, work.u
            )  # fmt: skip
            problem.mu[n] = 0.0
            for k in range(3):
                problem.q[n, k] = 0.0
                problem.r[n, k] = 0.0
            problem.q[n, 0] = state.gap[i] + work.u[i, 0]
            if problem.q[n, 0] < 0.0:  # a guess: each contact repairs its own violation
                problem.r[n, 0] = -problem.q[n, 0] / normal_delassus(problem.rows, n)
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
def displace(bodies, state, displacement):
    """Move every body by a displacement, shape (nb + 1, 6)."""
    for body in range(bodies.mass.shape[0]):
        d = displacement[body]
        for k in range(3):
            state.x[body, k] += d[k]
        turn(state.p[body], d[3], d[4], d[5])
        rotation_matrix(state.p[body], state.R[body])
