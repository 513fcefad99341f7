"""Contacts with a stiffness: springs that push where the bodies overlap, with the damper beside them.

The spring is implicit and no load of its own: it makes the normal row of its contact soft. With the impulse r of a step
the law 0 <= r, u_N + shift + softness r >= 0 holds, the two orthogonal; softness r is the row of a node of its own, see
`contacts.whitened_rows`. So friction, other contacts and joints are solved with it, and no stiffness limits the step.

Where a step resolves the oscillation of the bodies on the spring, the force is that of the mean gap of the step,
F = -k (g + g')/2 - d (g' - g)/h: energy is kept, to second order. In the step in which the contact closes it is that of
the last gap, F = -k g' - d g'/h. Where steps are longer, and near rest, the contact is a rigid one that starts from the
overlap that its spring already has, F = k max(-g, 0) - (k after + d) u_N, and no more: the projection takes out what is
deeper than it was and than F/k.
"""

import numpy as np

from engine.friction.blocks import ROW
from engine.jit import not_inlined
from engine.kernels.contacts import contact_velocity, mobility

RESOLVED = 1.0  # largest square of the angle, frequency times step, of an oscillation that a step resolves


@not_inlined
def soften(bodies, contacts, state, work, problem, n, times):
    """Give the contacts of a friction problem that have a stiffness the law of their springs; there are ``n`` contacts.

    ``times`` are what has passed of the step, what remains of it, and how long a force acts in it.
    """
    before, after, time = times
    h = before + after
    for j in range(n):
        i = work.chosen[j]
        k, d, gap = contacts.stiffness[i], contacts.damping[i], work.gap[i]
        if k == 0.0:
            continue
        contact_velocity(contacts, state.x, state.R, work.sites, work.start.v, i, work.u)
        begun = gap - before * work.u[i, 0]
        overlap = min(begun, 0.0)
        mobile = mobility(bodies, state, work.sites, contacts.a[i], i)
        mobile += mobility(bodies, state, work.sites, contacts.b[i], i)
        if before > 0.0 and k * h * h * mobile <= RESOLVED:
            weight = (0.5 * k if begun < 0.0 else k) + d / h
            pushed = weight * gap + (k - weight) * overlap
            work.depth[i] = np.inf
        else:
            weight = k + d / after
            pushed = k * (max(gap - overlap, 0.0) + overlap)
            work.depth[i] = 0.0
        work.begun[i] = begun
        work.shift[i] = pushed / (weight * after)
        problem.q[j, 0] = work.q[i, 0] + work.shift[i]
        problem.rows.G[j, 0, 2 * ROW] = np.sqrt(1.0 / (time * weight * after))


@not_inlined
def compress(contacts, work, problem, n, after, time):
    """Write how deep the impulses of a step press contacts with a stiffness; return what their springs have stored.

    What the springs add to the velocities of the problem becomes part of the shifts of its ``n`` contacts. ``after``
    is what remains of the step, and the impulses act for ``time``.
    """
    total = 0.0
    for j in range(n):
        i = work.chosen[j]
        k, r = contacts.stiffness[i], problem.r[j, 0]
        if k == 0.0:
            continue
        work.shift[i] += problem.rows.G[j, 0, 2 * ROW] ** 2 * r
        if work.depth[i] < np.inf:
            work.depth[i] = max(r / (time * k), -work.begun[i])
        speed = problem.u[j, 0] - work.shift[i]
        begun, end = min(work.begun[i], 0.0), min(max(work.gap[i] + after * speed, -work.depth[i]), 0.0)
        total += 0.5 * k * (end * end - begun * begun)
    return total


@not_inlined
def hold_compression(bodies, contacts, state, work, rows, h, i, j):
    """Make contact i, contact j of a problem, carry the force of its overlap for the time ``h``, and little else.

    ``work.q[i]`` is changed. Its spring is as mobile as its bodies.
    """
    mobile = mobility(bodies, state, work.sites, contacts.a[i], i)
    mobile += mobility(bodies, state, work.sites, contacts.b[i], i)
    rows.G[j, 0, 2 * ROW] = np.sqrt(mobile)
    work.q[i, 0] -= mobile * h * contacts.stiffness[i] * max(-work.gap[i], 0.0)
