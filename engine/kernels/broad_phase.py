"""Which contacts need a look: the others are too far for the bodies to have closed their gaps meanwhile.

A gap is a distance, so it closes no faster than its two points approach. Each contact keeps a budget, its gap when it
was last found; every displacement takes the way its bodies' points may have gone from it. While something is left,
the contact is open. The bound is sure, hence the results of fixed steps do not depend on it; the length of adaptive
steps is judged by the contacts that were looked at.
"""

import numpy as np

from engine.jit import inner
from engine.kernels.gaps import find_contact


@inner
def rates(twist, rate):
    """Write every body's speed and angular speed, shape (nb + 1, 2)."""
    for body in range(rate.shape[0] - 1):
        v = twist[body]
        rate[body, 0] = np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
        rate[body, 1] = np.sqrt(v[3] * v[3] + v[4] * v[4] + v[5] * v[5])


@inner
def closing(a, b, reach, watch, i):
    """Return how fast contact i's gap may close at most, between bodies a and b."""
    rate = watch.rate
    return rate[a, 0] + rate[b, 0] + reach * rate[a, 1] + watch.lever[i] * rate[b, 1]


@inner
def spend(a, b, reach, twist, dt, watch):
    """Take a displacement ``dt`` times the twists from every contact's budget."""
    rates(twist, watch.rate)
    for i in range(a.shape[0]):
        watch.budget[i] -= dt * closing(a[i], b[i], reach[i], watch, i)


@inner
def look(contacts, x, R, i, watch, gap, point, frame):
    """Find contact i at the pose (x, R): its gap, point, frame, and its budget anew."""
    gap[i] = find_contact(contacts, x, R, i, point, frame)
    watch.near[i], watch.budget[i] = True, gap[i]
    a, b = contacts.a[i], contacts.b[i]
    d0, d1, d2 = x[a, 0] - x[b, 0], x[a, 1] - x[b, 1], x[a, 2] - x[b, 2]
    lever = np.sqrt(d0 * d0 + d1 * d1 + d2 * d2) + contacts.reach[i]
    watch.lever[i] = lever + 2 * abs(gap[i]) + abs(contacts.clearance[i])  # a skin is part of the clearance


@inner
def look_around(contacts, x, R, watch, dt, distance, gap, point, frame):
    """Find the contacts whose gap could be within ``distance`` after ``dt`` at the speeds ``watch.rate``.

    Of the others the gap written is a lower bound.
    """
    for i in range(gap.shape[0]):
        gap[i] = watch.budget[i]
        watch.near[i] = False
        within = distance + dt * closing(contacts.a[i], contacts.b[i], contacts.reach[i], watch, i)
        if not watch.budget[i] > within:  # also a NaN
            look(contacts, x, R, i, watch, gap, point, frame)
