"""Which contacts need a look: the others are too far for the bodies to have closed their gaps meanwhile.

A gap is a distance, so it closes no faster than its two points approach. Each contact keeps a budget, its gap when it
was last found; every displacement takes the way its bodies' points may have gone from it. While something is left,
the contact is open. The bound is sure, hence results do not depend on it.
"""

import numpy as np

from engine.kernels.gaps import find_contact
from engine.kernels.jit import kernel


@kernel
def rates(x, twist, rate):
    """Write every body's speed and angular speed, shape (nb + 1, 2)."""
    for body in range(x.shape[0] - 1):
        v = twist[body]
        rate[body, 0] = np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
        rate[body, 1] = np.sqrt(v[3] * v[3] + v[4] * v[4] + v[5] * v[5])


@kernel
def closing(contacts, rate, lever, i):
    """Return how fast contact i's gap may close at most."""
    a, b = contacts.a[i], contacts.b[i]
    return rate[a, 0] + rate[b, 0] + contacts.reach[i] * rate[a, 1] + lever[i] * rate[b, 1]


@kernel
def spend(contacts, x, twist, dt, rate, lever, budget):
    """Take a displacement ``dt`` times the twists from every contact's budget."""
    rates(x, twist, rate)
    for i in range(budget.shape[0]):
        budget[i] -= dt * closing(contacts, rate, lever, i)


@kernel
def look(contacts, x, R, i, work, gap):
    """Find contact i at the pose (x, R): its gap, point, frame, and its budget anew."""
    gap[i] = find_contact(contacts, x, R, i, work.point, work.frame)
    work.near[i], work.budget[i] = True, gap[i]
    a, b = contacts.a[i], contacts.b[i]
    d0, d1, d2 = x[a, 0] - x[b, 0], x[a, 1] - x[b, 1], x[a, 2] - x[b, 2]
    work.lever[i] = np.sqrt(d0 * d0 + d1 * d1 + d2 * d2) + contacts.reach[i] + 2 * abs(gap[i])


@kernel
def look_ahead(contacts, x, R, work, dt, gap):
    """Find the contacts that could close within ``dt`` at the speeds ``work.rate``; the others' gap is a bound."""
    for i in range(gap.shape[0]):
        gap[i] = work.budget[i]
        work.near[i] = False
        if not work.budget[i] > dt * closing(contacts, work.rate, work.lever, i):  # also a NaN
            look(contacts, x, R, i, work, gap)


@kernel
def look_within(contacts, x, R, work, distance, gap):
    """Find the contacts that could be open by no more than ``distance``; the others' gap is a bound."""
    for i in range(gap.shape[0]):
        gap[i] = work.budget[i]
        work.near[i] = False
        if not work.budget[i] > distance:
            look(contacts, x, R, i, work, gap)
