"""Velocity stage: which contacts take part, their friction problem, and the twists it gives (eqs. 6, 21, 22)."""

import numpy as np

from engine.kernels.contacts import add_whitened, relative_velocity, whitened_rows
from engine.kernels.jit import kernel


@kernel
def free_relative_velocities(contacts, laws, state, work, h):
    """Write each contact's relative velocity without impulses, ``work.q``, and its impact law's shift, ``work.shift``.

    Without restitution a contact may close within the step but not overshoot, u_N + 2 max(g_N, 0)/h >= 0 from mid-step
    on. With restitution the law is Newton's, u_N + e u_N^- >= 0 (eq. 6).
    """
    for i in range(laws.mu.shape[0]):
        a, b = contacts.a[i], contacts.b[i]
        relative_velocity(state.x, state.R, a, b, work.point, work.frame, work.free, i, work.q)
        if laws.restitution[i] > 0.0:
            relative_velocity(state.x, state.R, a, b, work.point, work.frame, state.v, i, work.u)
            work.shift[i] = min(laws.restitution[i] * work.u[i, 0], 0.0)
        else:
            work.shift[i] = max(2 * work.gap[i] / h, 0.0)


@kernel
def first_active_set(laws, work, r, h):
    """Activate contacts that would pass through each other without an impulse, or that pressed in the last step."""
    for i in range(laws.mu.shape[0]):
        gap, approach = work.gap[i], 0.5 * h * work.q[i, 0]
        if laws.restitution[i] > 0.0:
            work.active[i] = gap <= 0.0
        else:
            work.active[i] = gap + approach <= 0.0 or (r[i, 0] > 0.0 and gap <= 2 * abs(approach))
        if not work.active[i]:
            r[i, 0], r[i, 1], r[i, 2] = 0.0, 0.0, 0.0


@kernel
def gather(bodies, contacts, laws, state, work, problem):
    """Write the friction problem of the active contacts; return their number."""
    n = 0
    for i in range(laws.mu.shape[0]):
        if work.active[i]:
            work.chosen[n] = i
            whitened_rows(
                bodies, state.x, state.R, contacts.a[i], contacts.b[i], work.point, work.frame, i, problem.rows, n
            )  # fmt: skip
            problem.mu[n] = laws.mu[i]
            for k in range(3):
                problem.q[n, k] = work.q[i, k]
                problem.r[n, k] = state.r[i, k]
            problem.q[n, 0] += work.shift[i]
            n += 1
    return n


@kernel
def scatter(bodies, state, work, n, problem):
    """Take impulses, slip speeds and twists from the solved problem."""
    for j in range(n):
        i = work.chosen[j]
        for k in range(3):
            state.r[i, k] = problem.r[j, k]
        state.slip[i] = np.sqrt(problem.u[j, 1] ** 2 + problem.u[j, 2] ** 2)
    for body in range(bodies.mass.shape[0]):
        for k in range(6):
            state.v[body, k] = work.free[body, k]
    add_whitened(bodies, problem.w, state.v)


@kernel
def grow_active_set(contacts, state, work, h):
    """Activate every contact that the new twists would drive into penetration (eq. 22); return how many."""
    added, fastest = 0, 0.0
    for i in range(work.active.shape[0]):
        relative_velocity(state.x, state.R, contacts.a[i], contacts.b[i], work.point, work.frame, state.v, i, work.u)
        fastest = max(fastest, work.u[i, 0] ** 2 + work.u[i, 1] ** 2 + work.u[i, 2] ** 2)
        if not work.active[i] and work.u[i, 0] < 0.0 and work.gap[i] + 0.5 * h * work.u[i, 0] < 0.0:
            work.active[i] = True
            added += 1
    state.speed[0] = np.sqrt(fastest)
    return added
