"""Impacts: contacts that close in a step and take the momentum of their bodies in it, however short it is."""

import numpy as np

from engine.jit import inner
from engine.kernels.contacts import contact_velocity, mobility


@inner
def largest_impact(bodies, contacts, state, work):
    """Return the largest impulse with which a contact stopped its bodies in the last step; ``work.u`` is overwritten.

    It is the smaller of two: the momentum with which the bodies approached each other at the start of the step, and
    what the normal impulse has gained over that of the step before. So neither a lasting contact on a curved surface
    counts, where the path bends, nor a load that is applied suddenly.
    """
    largest, x, R, sites = 0.0, state.x, state.R, work.sites
    for i in range(state.r.shape[0]):
        gained = state.r[i, 0] - work.start.r[i, 0]
        if not gained > largest or work.depth[i] == np.inf:
            continue
        a, b = contacts.a[i], contacts.b[i]
        contact_velocity(contacts, x, R, sites, work.start.v, i, work.u)
        if work.u[i, 0] < 0.0:
            mass = 1.0 / (mobility(bodies, state, sites, a, i) + mobility(bodies, state, sites, b, i))
            largest = max(largest, min(gained, -work.u[i, 0] * mass))
    return largest
