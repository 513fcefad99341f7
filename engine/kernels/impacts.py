"""Impacts: contacts that close in a step and take the momentum of their bodies in it, however short it is."""

from engine.jit import inner
from engine.kernels.contacts import contact_velocity


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
        if not gained > largest:
            continue
        a, b = contacts.a[i], contacts.b[i]
        contact_velocity(contacts, x, R, sites, work.start.v, i, work.u)
        if work.u[i, 0] < 0.0:
            mass = 1.0 / (_mobility(bodies, state, sites, a, i) + _mobility(bodies, state, sites, b, i))
            largest = max(largest, min(gained, -work.u[i, 0] * mass))
    return largest


@inner
def _mobility(bodies, state, sites, body, i):
    """Return the velocity that a unit impulse along the normal of contact i gives a body at its point."""
    if body >= bodies.mass.shape[0]:
        return 0.0
    R, root, N = state.R[body], bodies.inverse_root[body], sites.frame[i, 0]
    d0, d1 = sites.point[i, 0] - state.x[body, 0], sites.point[i, 1] - state.x[body, 1]
    d2 = sites.point[i, 2] - state.x[body, 2]
    m0, m1, m2 = d1 * N[2] - d2 * N[1], d2 * N[0] - d0 * N[2], d0 * N[1] - d1 * N[0]
    spin = 0.0
    for k in range(3):
        turned = 0.0
        for j in range(k + 1):
            turned += root[k, j] * (R[0, j] * m0 + R[1, j] * m1 + R[2, j] * m2)
        spin += turned * turned
    return 1.0 / bodies.mass[body] + spin
