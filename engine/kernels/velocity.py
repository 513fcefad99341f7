"""Velocity stage: the active contacts, their friction problem, and the resulting twists (eqs. 6, 21, 22)."""

import numpy as np

from engine.friction.complementarity import natural_mismatch
from engine.jit import inner, not_inlined
from engine.jit.lanes import LANES, read, write
from engine.kernels.broad_phase import body_speeds, closing_speed, update_contact
from engine.kernels.contacts import add_whitened, aim_centred, contact_velocity, press, whitened_rows
from engine.kernels.grain import lengths
from engine.kernels.loads import table_at
from engine.kernels.model import RING_BORE, ROLLING

STANDS = 1e-4  # share of the speed that friction takes in a step; the solver leaves less of a contact that sticks


@inner
def free_relative_velocities(contacts, laws, state, work, within, plain, bounce):
    """Write the relative velocities without impulses, and the impact law's shifts, of all near contacts.

    The times ``within`` are what remains of the step and its length; ``bounce`` is a factor of the coefficients of
    restitution.
    """
    for i in range(laws.mu.shape[0]):
        if work.broad_phase.near[i]:
            if not plain:
                aim_centred(contacts, state, work, work.free, within[0], i)
            free_relative_velocity(contacts, laws, state, work, within, plain, bounce, i)


@inner
def free_relative_velocity(contacts, laws, state, work, within, plain, bounce, i):
    """Write contact i's relative velocity without impulses, and the shift of its law.

    Without restitution a contact may close within the remaining time of the step but not overshoot,
    u_N + max(g_N, 0)/dt >= 0. One that lasts, and that a curved path has opened, closes until the middle of the next
    step instead, a whole step from here: if it closed sooner, it would overlap there, and open again in every second
    step, and its force would swing about the right one, however short the step. The path of a ring in its bore is
    hollow and opens nothing. With restitution, and in the ``plain`` scheme, the law is Newton's, u_N + e u_N^- >= 0
    (eq. 6).
    """
    x, R = state.x, state.R
    e = bounce * laws.restitution[i]
    contact_velocity(contacts, x, R, work.sites, work.free, i, work.q)
    if e > 0.0:
        contact_velocity(contacts, x, R, work.sites, work.start.v, i, work.u)
        work.shift[i] = min(e * work.u[i, 0], 0.0)
    else:
        rest, whole = within
        lasts = work.start.r[i, 0] > 0.0 and contacts.kind[i] != RING_BORE
        work.shift[i] = 0.0 if plain else max(work.gap[i] / (whole if lasts else rest), 0.0)


@inner
def first_active_set(laws, state, work, dt, plain, bounce):
    """Activate the contacts that would penetrate without an impulse, or that carried load in the last step."""
    r, active = state.r, work.active
    for i in range(laws.mu.shape[0]):
        gap, approach = work.gap[i], dt * work.q[i, 0]
        if bounce * laws.restitution[i] > 0.0 or plain:
            active[i] = gap <= 0.0
        else:
            active[i] = gap + approach <= 0.0 or (r[i, 0] > 0.0 and gap <= 2 * abs(approach))
        active[i] = active[i] and work.broad_phase.near[i]
        if not active[i]:
            r[i, 0], r[i, 1], r[i, 2] = 0.0, 0.0, 0.0


@inner
def look_at_active_contacts(contacts, state, work):
    """Write sites and velocities (without impulses; at the start) of the active contacts at a temporary pose."""
    for i in range(work.active.shape[0]):
        if work.active[i]:
            sites = work.sites
            update_contact(contacts, state, work.broad_phase, sites, i, work.gap)
            if not work.broad_phase.near[i]:  # it passes by, see `gaps.passes_by`
                work.active[i] = False
                state.r[i, 0], state.r[i, 1], state.r[i, 2] = 0.0, 0.0, 0.0
            contact_velocity(contacts, state.x, state.R, sites, work.free, i, work.q)
            contact_velocity(contacts, state.x, state.R, sites, work.start.v, i, work.u)
            work.broad_phase.budget[i] = 0.0


@not_inlined
def friction_in_step(contacts, laws, tables, state, work, problem, i, n):
    """Return the coefficient of contact i, contact n of the problem, in a step: that of one that sticks, or slides.

    It sticks if it stands at the start of the step: to a share of the speed that friction takes in it. With a table it
    is that of the speed there.
    """
    load, u = work.start.r[i, 0], work.start.u[i]
    if not load > 0.0:  # it closes, or the run begins
        contact_velocity(contacts, state.x, state.R, work.sites, work.start.v, i, work.u)
        u = work.u[i]
    if laws.table.shape[0] > 0 and laws.table[i] >= 0:
        first, second = lengths(contacts, i)
        speed = np.sqrt((u[1] / first) ** 2 + (u[2] / second) ** 2)
        return laws.mu[i] * table_at(tables, laws.table[i], speed)
    normal, along = 0.0, 0.0
    for k in range(problem.rows.G.shape[2]):
        normal += problem.rows.G[n, 0, k] ** 2
        along += 0.5 * (problem.rows.G[n, 1, k] ** 2 + problem.rows.G[n, 2, k] ** 2)
    pressed = load + (max(-u[0], 0.0) / normal if normal > 0.0 else 0.0)
    stands = np.sqrt(u[1] ** 2 + u[2] ** 2) <= STANDS * laws.sticking[i] * pressed * along
    return laws.sticking[i] if stands else laws.mu[i]


@inner
def gather_problem(bodies, contacts, laws, tables, state, work, problem, time):
    """Write the friction problem of the active contacts, starting from the last impulses; return their number.

    A force acts for the given ``time`` in the step; ``tables`` are the laws among which are those of friction.
    """
    n = 0
    for i in range(laws.mu.shape[0]):
        if work.active[i]:
            work.chosen[n] = i
            whitened_rows(bodies, contacts, state.x, state.R, work.sites, i, problem.rows, n)
            problem.mu[n] = laws.mu[i]
            if laws.sticking.shape[0] > 0:
                problem.mu[n] = friction_in_step(contacts, laws, tables, state, work, problem, i, n)
            for k in range(3):
                problem.q[n, k] = work.q[i, k]
                problem.r[n, k] = state.r[i, k]
            problem.q[n, 0] += work.shift[i]
            if contacts.bound[i] > 0.0:
                contact_velocity(contacts, state.x, state.R, work.sites, work.start.v, i, work.u)
                problem.r[n, 0] = press(contacts, i, time, work.u[i, 1], problem, n)
            n += 1
    return n


@inner
def apply_impulses(bodies, contacts, state, work, problem, n):
    """Copy the impulses, slip speeds and twists from the solved problem of ``n`` contacts."""
    for j in range(n):
        i = work.chosen[j]
        for k in range(3):
            state.r[i, k] = problem.r[j, k]
        first, second = lengths(contacts, i)
        state.slip[i] = np.sqrt((problem.u[j, 1] / first) ** 2 + (problem.u[j, 2] / second) ** 2)
    for body in range(bodies.mass.shape[0]):
        for k in range(6):
            state.v[body, k] = work.free[body, k]
    if n > 0:
        add_whitened(bodies, problem.w, state.v)


@inner
def grow_active_set(contacts, laws, state, work, within, all_near, bounce):
    """Activate each contact that the new twists would drive into penetration (eq. 22); return their number.

    An impact that runs along a chain closes its contacts one after the other, and each would require a problem of its
    own. With ``all_near`` the first of them activates all near contacts; those that stay open get no impulse. Contacts
    with restitution are excluded, because Newton's law would hold them although they are open.
    """
    broad_phase, dt, added = work.broad_phase, within[0], 0
    body_speeds(state.v, broad_phase.speed)
    for i in range(work.active.shape[0]):
        if not broad_phase.near[i]:
            if broad_phase.budget[i] > dt * closing_speed(contacts, broad_phase, i):
                continue
            update_contact(contacts, state, broad_phase, work.sites, i, work.gap)
            aim_centred(contacts, state, work, state.v, dt, i)
            free_relative_velocity(contacts, laws, state, work, within, False, bounce, i)
        # a centred pin is aimed again, as the impulses found so far may drive it: a needle that another part pushes
        elif not work.active[i] and aim_centred(contacts, state, work, state.v, dt, i):
            free_relative_velocity(contacts, laws, state, work, within, False, bounce, i)
        contact_velocity(contacts, state.x, state.R, work.sites, state.v, i, work.u)
        if not work.active[i] and work.u[i, 0] < 0.0 and work.gap[i] + dt * work.u[i, 0] < 0.0:
            work.active[i] = True
            added += 1
    if all_near and added > 0:
        for i in range(work.active.shape[0]):
            closes = broad_phase.near[i] and not bounce * laws.restitution[i] > 0.0
            work.active[i] = work.active[i] or (closes and contacts.kind[i] < ROLLING)
    return added


@inner
def worst_contact(problem, chosen, n):
    """Return the contact, of the ``n`` in ``chosen``, with the largest residual, see `complementarity.residual`."""
    c, worst, where = problem.contacts, -1.0, -1
    for j in range(0, n, LANES):
        s, u1, u2 = read(c.scale, j), read(c.u[1], j), read(c.u[2], j)
        r0, r1, r2 = s * read(c.r[0], j), s * read(c.r[1], j), s * read(c.r[2], j)
        write(natural_mismatch(read(c.mu, j), r0, r1, r2, read(c.u[0], j), u1, u2), c.x[0], j)
    for j in range(n):
        if not c.x[0, j] <= worst:  # NaN counts as the worst
            worst, where = c.x[0, j], chosen[j]
    return where
