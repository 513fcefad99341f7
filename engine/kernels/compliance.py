"""Contacts with a stiffness: springs that push where the bodies overlap, with the damper beside them.

The spring is implicit and no load of its own: it makes the normal row of its contact soft. With the impulse r of a step
the law 0 <= r, u_N + shift + softness r >= 0 holds, the two orthogonal; softness r is the row of a node of its own, see
`contacts.whitened_rows`. So friction, other contacts and joints are solved with it, and no stiffness limits the step.

Where a step resolves the oscillation of the bodies on the spring, the force is that of the mean gap of the step,
F = -k (g + g')/2 - d (g' - g)/h: energy is kept, to second order. In the step in which the contact closes it is that of
the last gap, F = -k g' - d g'/h. Where steps are longer, and near rest, the contact is a rigid one that starts from the
overlap that its spring already has, F = k max(-g, 0) - (k after + d) u_N, and no more: the projection takes out what is
deeper than it was and than F/k.

A contact of Hertz, F = k overlap^1.5, has the straight line in place of this curve that touches it where the overlap at
the end of the step was last found (Newton's method). Where the step resolves the oscillation the mean is that by which
the spring does exactly the work that it stores, (E(g') - E(g)) / (g - g').
"""

import numpy as np

from engine.friction.blocks import ROW
from engine.jit import inner, kernel, not_inlined
from engine.kernels.contacts import contact_velocity, mobility

RESOLVED = 1.0  # largest square of the angle, frequency times step, of an oscillation that a step resolves
SOFTEST = 1e-8  # smallest such square of a line in place of Hertz's law, which begins with none
TOUCHES = 1e-5  # share of the overlap by which the end of a step may differ from where its line touches the curve


@kernel
def elastic_force(contacts, i, overlap):
    """Return the force of contact i's spring at an overlap; none if that is < 0."""
    pressed = max(overlap, 0.0)
    return contacts.stiffness[i] * (pressed * np.sqrt(pressed) if contacts.hertz[i] else pressed)


@not_inlined
def soften(bodies, contacts, state, work, problem, n, times, first):
    """Give the contacts of a friction problem that have a stiffness the law of their springs; there are ``n`` contacts.

    ``times`` are what has passed of the step, what remains of it, and how long a force acts in it; ``first`` says
    whether this is the first problem of the step.
    """
    before, after, time = times
    h = before + after
    if first:
        for i in range(work.guess.shape[0]):
            work.guess[i] = -1.0
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
        if contacts.hertz[i]:
            work.begun[i] = begun
            weight, pushed = _line(k, d, mobile, work, i, before, after)
        elif before > 0.0 and k * h * h * mobile <= RESOLVED:
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
def _line(k, d, mobile, work, i, before, after):
    """Return the weight and the push of a contact of Hertz, as those of a linear one, at its ``guess``.

    The first guess is where the contact would be without its force.
    """
    h, gap, begun = before + after, work.gap[i], work.begun[i]
    overlap, least = min(begun, 0.0), SOFTEST / (h * h * mobile)
    base = -overlap - max(gap - overlap, 0.0)
    if work.guess[i] < 0.0:
        work.guess[i] = max(-gap - after * work.q[i, 0], -overlap, 0.0)
        stiffest = 1.5 * k * np.sqrt(work.guess[i])
        work.depth[i] = np.inf if before > 0.0 and stiffest * h * h * mobile <= RESOLVED else 0.0
    a, b, at = np.sqrt(-overlap), np.sqrt(work.guess[i]), work.guess[i]
    if work.depth[i] < np.inf:
        slope = max(1.5 * k * b, least)
        return slope + d / after, -(k * at * b + slope * (base - at))
    if a > 0.0:
        force = 0.4 * k * (a**4 + a**3 * b + a * a * b * b + a * b**3 + b**4) / (a + b)
        slope = 0.2 * k * (2 * a**3 + 4 * a * a * b + 6 * a * b * b + 3 * b**3) / (a + b) ** 2
    else:
        force, slope = k * at * b, 1.5 * k * b
    slope = max(slope, least)
    weight = slope + d / h
    return weight, weight * gap - force + slope * at - d / h * overlap


@inner
def bend(contacts, work, problem, n, after):
    """Move the lines of the contacts of Hertz to where the step ends; return how many were not there already."""
    moved = 0
    for j in range(n if work.guess.shape[0] else 0):
        i = work.chosen[j]
        if not contacts.hertz[i]:
            continue
        speed = problem.u[j, 0] - work.shift[i] - problem.rows.G[j, 0, 2 * ROW] ** 2 * problem.r[j, 0]
        overlap = min(work.begun[i], 0.0)
        base = -work.gap[i] if work.depth[i] == np.inf else -overlap - max(work.gap[i] - overlap, 0.0)
        end = max(base - after * speed, 0.0)
        if abs(end - work.guess[i]) > TOUCHES * max(end, work.guess[i]):
            moved += 1
        work.guess[i] = end
    return moved


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
            pressed = r / (time * k)
            work.depth[i] = max(pressed ** (2.0 / 3.0) if contacts.hertz[i] else pressed, -work.begun[i])
        speed = problem.u[j, 0] - work.shift[i]
        begun, end = min(work.begun[i], 0.0), min(max(work.gap[i] + after * speed, -work.depth[i]), 0.0)
        if contacts.hertz[i]:
            total += 0.4 * k * ((-end) ** 2.5 - (-begun) ** 2.5)
        else:
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
    work.q[i, 0] -= mobile * h * elastic_force(contacts, i, -work.gap[i])
