"""Velocity stage: which contacts take part, their friction problem, and the twists it gives (eqs. 6, 21, 22)."""

import numpy as np

from engine.friction.cone import project
from engine.jit import inner
from engine.kernels.broad_phase import closing, look, rates
from engine.kernels.contacts import add_whitened, relative_velocity, whitened_rows


@inner
def free_relative_velocities(contacts, laws, state, work, dt, plain):
    """Write the relative velocities without impulses and the impact law's shifts of all near contacts."""
    for i in range(laws.mu.shape[0]):
        if work.watch.near[i]:
            work.shift[i] = free_relative_velocity(
                contacts.a[i], contacts.b[i], laws.restitution[i], state.x, state.R, work.kept.v, work.free,
                work.gap, work.point, work.frame, work.q, work.u, dt, plain, i,
            )  # fmt: skip


@inner
def free_relative_velocity(a, b, e, x, R, before, free, gap, point, frame, q, u, dt, plain, i):
    """Write contact i's relative velocity without impulses into ``q[i]``; return its law's shift.

    ``dt`` is what is left of the step. Without restitution a contact may close within it but not overshoot,
    u_N + max(g_N, 0)/dt >= 0. With restitution, and in the ``plain`` scheme, the law is Newton's, u_N + e u_N^- >= 0
    (eq. 6).
    """
    relative_velocity(x, R, a, b, point, frame, free, i, q)
    if e > 0.0:
        relative_velocity(x, R, a, b, point, frame, before, i, u)
        return min(e * u[i, 0], 0.0)
    return 0.0 if plain else max(gap[i] / dt, 0.0)


@inner
def first_active_set(laws, near, gaps, q, r, dt, plain, active):
    """Activate contacts that would pass through each other without an impulse, or that pressed in the last step."""
    for i in range(laws.mu.shape[0]):
        gap, approach = gaps[i], dt * q[i, 0]
        if laws.restitution[i] > 0.0 or plain:
            active[i] = gap <= 0.0
        else:
            active[i] = gap + approach <= 0.0 or (r[i, 0] > 0.0 and gap <= 2 * abs(approach))
        active[i] = active[i] and near[i]
        if not active[i]:
            r[i, 0], r[i, 1], r[i, 2] = 0.0, 0.0, 0.0


@inner
def gather(bodies, contacts, laws, x, R, guess, work, rows, mu, q, r):
    """Write the friction problem of the active contacts, ``guess`` (nc, 3) into its impulses; return their number."""
    n = 0
    for i in range(laws.mu.shape[0]):
        if work.active[i]:
            work.chosen[n] = i
            whitened_rows(bodies, x, R, contacts.a[i], contacts.b[i], work.point, work.frame, i, rows, n)
            mu[n] = laws.mu[i]
            for k in range(3):
                q[n, k] = work.q[i, k]
                r[n, k] = guess[i, k]
            q[n, 0] += work.shift[i]
            n += 1
    return n


@inner
def scatter(bodies, chosen, n, r, u, w, free, state):
    """Take impulses, slip speeds and twists from the solved problem."""
    for j in range(n):
        i = chosen[j]
        for k in range(3):
            state.r[i, k] = r[j, k]
        state.slip[i] = np.sqrt(u[j, 1] ** 2 + u[j, 2] ** 2)
    for body in range(bodies.mass.shape[0]):
        for k in range(6):
            state.v[body, k] = free[body, k]
    if n > 0:
        add_whitened(bodies, w, state.v)


@inner
def grow_active_set(contacts, laws, state, work, dt):
    """Activate every contact that the new twists would drive into penetration (eq. 22).

    Returns
    -------
    added : how many
    fastest : speed of the fastest near contact point relative to its partner
    """
    added, fastest, watch = 0, 0.0, work.watch
    rates(state.v, watch.rate)
    for i in range(work.active.shape[0]):
        a, b = contacts.a[i], contacts.b[i]
        if not watch.near[i]:
            if watch.budget[i] > dt * closing(a, b, contacts.reach[i], watch, i):
                continue
            look(contacts, state.x, state.R, i, watch, work.gap, work.point, work.frame)
            work.shift[i] = free_relative_velocity(
                a, b, laws.restitution[i], state.x, state.R, work.kept.v, work.free,
                work.gap, work.point, work.frame, work.q, work.u, dt, False, i,
            )  # fmt: skip
        relative_velocity(state.x, state.R, a, b, work.point, work.frame, state.v, i, work.u)
        fastest = max(fastest, work.u[i, 0] ** 2 + work.u[i, 1] ** 2 + work.u[i, 2] ** 2)
        if not work.active[i] and work.u[i, 0] < 0.0 and work.gap[i] + dt * work.u[i, 0] < 0.0:
            work.active[i] = True
            added += 1
    return added, np.sqrt(fastest)


@inner
def worst_contact(mu, r, u, scale, chosen, n):
    """Return the contact with the largest residual of an unsolved problem, see `friction.cone.residual`."""
    worst, where = -1.0, -1
    for j in range(n):
        s = scale[j]
        slip = np.sqrt(u[j, 1] ** 2 + u[j, 2] ** 2)
        p0, p1, p2 = project(mu[j], s * r[j, 0] - u[j, 0] - mu[j] * slip, s * r[j, 1] - u[j, 1], s * r[j, 2] - u[j, 2])
        miss = (s * r[j, 0] - p0) ** 2 + (s * r[j, 1] - p1) ** 2 + (s * r[j, 2] - p2) ** 2
        if not miss <= worst:  # a NaN is the worst of all
            worst, where = miss, chosen[j]
    return where
