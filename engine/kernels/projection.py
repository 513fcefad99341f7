"""Position stage: remove remaining penetration and joint violation in the metric of the mass matrix (eq. 21).

Minimise 1/2 d' M d subject to g_N + G_N d >= 0 for the contacts near the violation and g_J + J d = 0 in the joints:
a friction problem with mu = 0 whose velocity is a displacement. The metric matters: unweighted coordinates diverge for
closed loops with clearance. But to spare a heavy body, a light one between two contacts moves far across, where its
bore curves away, and the next round finds as much penetration. Then the metric of equal masses leads on.
"""

import numpy as np

from engine.friction.arrays import CONVERGED, NOT_CONVERGED
from engine.friction.bilateral import factorise_bilateral, hold_bilateral
from engine.friction.blocks import ROW
from engine.friction.frictionless import fits, solve_frictionless
from engine.friction.solver import solve_friction
from engine.jit import inner
from engine.jit.lanes import fused, read, spread, total
from engine.kernels.bilateral import rows_at_pose, slack, whitened_bilateral_rows
from engine.kernels.broad_phase import consume_budget, find_contacts_within, find_near_contacts
from engine.kernels.contacts import add_whitened, contact_velocity, write_rows
from engine.kernels.energy import work_of_displacement
from engine.kernels.model import JOINT_FRICTION
from engine.kernels.vectors import rotation_matrix, turn

ROUNDS = 40  # long chains with play need as many
REACH = 2.0  # contacts with gaps below this multiple of the violation take part
TOLERANCE = 1e-4  # of a displacement problem: the next round removes the remainder
PATIENCE = 3  # rounds that may leave more than half of the violation before all bodies get equal masses


@inner
def project_positions(bodies, metric, contacts, rows, state, work, problem, control):
    """Displace the bodies until each contact and joint violates its constraint by at most half its limit.

    Return the largest remaining penetration, its contact (-1: none), the largest remaining joint violation that counts,
    the largest of all, and the work of the displacement against the loads of the step, ``work.wrench``. That of a row
    that others hold already counts only beyond its `slack`.
    """
    at_pose, displacement = work.bilateral, work.free
    worst, contact, off, widest, lifted = 0.0, -1, 0.0, 0.0, 0.0
    least, poor = np.inf, 0
    for made in range(ROUNDS + 1):
        find_near_contacts(contacts, state, work.broad_phase, work.sites, 0.0, 0.0, state.gap)
        worst, contact = largest_penetration(state.gap, work.depth)
        rows_at_pose(rows, state, at_pose)
        off, widest = largest_violations(metric, rows, at_pose)
        # the second condition: NaN or infinite, which the time loop reports as diverged
        if (worst <= 0.5 * control.penetration and off <= 0.5 * control.violation) or not worst + off < 1e300:
            break
        if made == ROUNDS:
            break
        if max(worst, off) < 0.5 * least:
            least, poor = max(worst, off), 0
        else:
            poor += 1
        weights = metric if poor > PATIENCE else bodies
        within = REACH * max(worst, off)
        find_contacts_within(contacts, state, work.broad_phase, work.sites, within, state.gap)
        for body in range(displacement.shape[0]):
            for k in range(6):
                displacement[body, k] = 0.0
        # joints first: the contacts' problem holds J d = 0, and starts from the gaps that this displacement leaves
        if at_pose.violation.shape[0] > 0:
            whitened_bilateral_rows(
                weights, rows, state.x, state.R, at_pose.point, at_pose.direction, problem.bilateral.J
            )
            factorise_bilateral(problem.system, problem.bilateral)
            hold_bilateral(problem.system, problem.bilateral, at_pose.violation, problem.w)
            add_whitened(weights, problem.w, displacement)
        nc = count_contacts(contacts, state, work, within)
        if nc > 0:
            solved = NOT_CONVERGED
            for friction in range(0 if fits(nc, problem) else 1, 2):  # with the method for friction, which takes all
                count = 3 if friction else 1
                gather_displacement_problem(weights, contacts, state, work, displacement, problem, within, count)
                if friction:
                    solved, _, _ = solve_friction(nc, problem, TOLERANCE)
                else:
                    solved = solve_frictionless(nc, problem, TOLERANCE)
                if solved == CONVERGED:
                    break
            if solved != CONVERGED:
                break
            add_whitened(weights, problem.w, displacement)
        consume_budget(contacts, displacement, 1.0, work.broad_phase)
        lifted -= work_of_displacement(state.R, work.wrench, displacement)
        displace(displacement, state)
    return worst, contact, off, widest, lifted


@inner
def largest_penetration(gap, depth):
    """Return the largest penetration beyond a contact's ``depth``, which is >= 0, and its contact.

    It is NaN if any gap is NaN.
    """
    worst, where = 0.0, -1
    for i in range(gap.shape[0]):
        deep = -gap[i] - depth[i]
        if not deep <= worst:  # NaN counts as the worst
            worst, where = deep, i
    return worst, where


@inner
def largest_violations(metric, rows, at_pose):
    """Return the largest joint violation beyond a row's slack, and the largest of all; NaN if any is NaN."""
    off, widest = 0.0, 0.0
    for i in range(at_pose.violation.shape[0]):
        size = abs(at_pose.violation[i])
        if not size <= widest:
            widest = size
        if not size <= off and not size <= slack(metric, rows, at_pose, i):
            off = size
    return off, widest


@inner
def takes_part(contacts, state, work, within, i):
    """Return whether contact i takes part: its gap, counted from the depth to which it may penetrate, is small."""
    return state.gap[i] + work.depth[i] <= within and contacts.kind[i] < JOINT_FRICTION  # a direction has no place


@inner
def count_contacts(contacts, state, work, within):
    """Return the number of contacts that take part."""
    n = 0
    for i in range(state.gap.shape[0]):
        n += 1 if takes_part(contacts, state, work, within, i) else 0
    return n


@inner
def gather_displacement_problem(bodies, contacts, state, work, displacement, problem, within, count):
    """Write the displacement problem of the contacts that take part, with ``count`` rows each: 1 or 3."""
    n, sites, u, joints = 0, work.sites, work.u, work.bilateral.violation.shape[0] > 0
    for i in range(state.gap.shape[0]):
        if takes_part(contacts, state, work, within, i):
            write_rows(bodies, contacts, state.x, state.R, sites, i, problem.rows, n, count)
            problem.mu[n] = 0.0
            for k in range(3):
                problem.q[n, k] = 0.0
                problem.r[n, k] = 0.0
            problem.q[n, 0] = state.gap[i] + work.depth[i]
            if joints:
                contact_velocity(contacts, state.x, state.R, sites, displacement, i, u)
                problem.q[n, 0] += u[i, 0]
            if problem.q[n, 0] < 0.0:  # initial guess: each contact corrects its own violation
                problem.r[n, 0] = -problem.q[n, 0] / normal_delassus(problem.rows, n)
            n += 1


@inner
def normal_delassus(rows, j):
    """Return the normal entry of contact j's Delassus block."""
    square = spread(0.0)
    for s in range(rows.node.shape[1]):
        if rows.node[j, s] >= 0:
            g = read(rows.G[j, 0], ROW * s)
            square = fused(g, g, square)
    return total(square)


@inner
def displace(displacement, state):
    """Move each body by a displacement, shape (nb + 1, 6): of the centre of mass, and a rotation in body axes."""
    for body in range(state.x.shape[0] - 1):
        d = displacement[body]
        for k in range(3):
            state.x[body, k] += d[k]
        turn(state.p[body], d[3], d[4], d[5])
        rotation_matrix(state.p[body], state.R[body])
