"""Position stage: remove what is left of penetration and of joint violation, in the metric of the mass matrix (eq. 21).

Minimise 1/2 d' M d subject to g_N + G_N d >= 0 over the contacts near the violation and g_J + J d = 0 in the joints: a
friction problem with mu = 0 whose velocity is a displacement. The metric matters: unweighted coordinates diverge on
closed loops with clearance.
"""

from engine.friction.arrays import CONVERGED
from engine.friction.bilateral import hold_ties, tie_down
from engine.friction.solver import solve_friction
from engine.jit import inner
from engine.kernels.bilateral import tie_violations, whitened_ties
from engine.kernels.broad_phase import look_around, spend
from engine.kernels.contacts import add_whitened, relative_velocity, whitened_rows
from engine.kernels.rotations import rotation_matrix, turn

ROUNDS = 40
REACH = 2.0  # contacts open by less than this many times the violation take part
TOLERANCE = 1e-4  # of a displacement problem: the next round removes what is left


@inner
def project_positions(bodies, contacts, ties, state, work, problem, penetration, violation):
    """Displace the bodies until no contact penetrates by half of ``penetration``, no joint is off by half its limit.

    Returns
    -------
    worst, where : largest penetration left, and its contact
    off : largest joint violation left
    """
    worst, where, off, n = 0.0, -1, 0.0, problem.w.shape[0]
    watch, held, displacement = work.watch, work.held, work.free
    for _ in range(ROUNDS):
        look_around(contacts, state.x, state.R, watch, 0.0, 0.0, state.gap, work.point, work.frame)
        worst, where = largest_penetration(state.gap)
        tie_violations(ties, state.x, state.R, held.target[1], held.violation, held.point, held.way)
        off = largest_violation(held.violation)
        if (worst <= 0.5 * penetration and off <= 0.5 * violation) or not worst + off < 1e300:
            break
        within = REACH * max(worst, off)
        look_around(contacts, state.x, state.R, watch, 0.0, within, state.gap, work.point, work.frame)
        for body in range(displacement.shape[0]):
            for k in range(6):
                displacement[body, k] = 0.0
        if held.violation.shape[0] > 0:
            whitened_ties(bodies, ties, state.x, state.R, held.point, held.way, problem.ties.J)
            tie_down(n, problem.ties)
            hold_ties(n, problem.ties, held.violation, problem.w)
            add_whitened(bodies, problem.w, displacement)
        nc = gather_projection(
            bodies, contacts, state.x, state.R, state.gap, within, displacement, work.point, work.frame, work.u,
            problem.rows, problem.mu, problem.q, problem.r,
        )  # fmt: skip
        if nc > 0:
            solved, _, _ = solve_friction(n, nc, problem, TOLERANCE)
            if solved != CONVERGED:
                break
            add_whitened(bodies, problem.w, displacement)
        spend(contacts.a, contacts.b, contacts.reach, displacement, 1.0, watch)
        displace(displacement, state.x, state.p, state.R)
    return worst, where, off


@inner
def largest_penetration(gap):
    """Return the largest penetration (>= 0, NaN if any gap is) and its contact."""
    worst, where = 0.0, -1
    for i in range(gap.shape[0]):
        if not -gap[i] <= worst:  # a NaN is the worst of all
            worst, where = -gap[i], i
    return worst, where


@inner
def largest_violation(violation):
    """Return the largest size of a joint violation, NaN if any is."""
    off = 0.0
    for i in range(violation.shape[0]):
        if not abs(violation[i]) <= off:
            off = abs(violation[i])
    return off


@inner
def gather_projection(bodies, contacts, x, R, gap, within, displacement, point, frame, u, rows, mu, q, r):
    """Write the displacement problem of the contacts open by no more than ``within``; return their number."""
    n = 0
    for i in range(gap.shape[0]):
        if gap[i] <= within:
            a, b = contacts.a[i], contacts.b[i]
            whitened_rows(bodies, x, R, a, b, point, frame, i, rows, n)
            relative_velocity(x, R, a, b, point, frame, displacement, i, u)
            mu[n] = 0.0
            for k in range(3):
                q[n, k] = 0.0
                r[n, k] = 0.0
            q[n, 0] = gap[i] + u[i, 0]
            if q[n, 0] < 0.0:  # a guess: each contact repairs its own violation
                r[n, 0] = -q[n, 0] / normal_delassus(rows, n)
            n += 1
    return n


@inner
def normal_delassus(rows, j):
    """Return the normal entry of contact j's Delassus block."""
    s = 0.0
    for a in range(rows.width[j, 0] + rows.width[j, 1]):
        s += rows.G[j, 0, a] * rows.G[j, 0, a]
    return s


@inner
def displace(displacement, x, p, R):
    """Move every body by a displacement, shape (nb + 1, 6)."""
    for body in range(x.shape[0] - 1):
        d = displacement[body]
        for k in range(3):
            x[body, k] += d[k]
        turn(p[body], d[3], d[4], d[5])
        rotation_matrix(p[body], R[body])
