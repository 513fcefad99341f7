"""Rest: for some time, neither a measured length, a contact that carries load, nor a bushing moves."""

from engine.friction.blocks import BODY
from engine.jit import inner

LOADED = 1e-3  # share of the largest impulse above which a contact carries load


@inner
def slow(bodies, v, speed):
    """Return whether no body is faster than ``speed``: |v|^2 + O . I O / m, i.e. spin times the radius of gyration."""
    for body in range(bodies.mass.shape[0]):
        J, t = bodies.inertia[body], v[body]
        square = 0.0
        for k in range(3):
            spin = J[k, 0] * t[3] + J[k, 1] * t[4] + J[k, 2] * t[5]
            square += t[k] * t[k] + t[3 + k] * spin / bodies.mass[body]
        if not square <= speed * speed:
            return False
    return True


@inner
def start_pause(values, anchor, travel, bushings):
    """Save the current values and deflections, and reset the accumulated slip."""
    for i in range(values.shape[0]):
        anchor[i] = values[i]
    for i in range(travel.shape[0]):
        travel[i] = 0.0
    for i in range(bushings.off.shape[0]):
        for k in range(bushings.off.shape[1]):
            bushings.anchor[i, k] = bushings.off[i, k]


@inner
def moved(responses, bound, state, work, bushings, h, drift):
    """Return whether a measured length or what carries load has moved by more than ``drift`` in this pause.

    A contact or a bushing may carry load; a bushing yields in the directions in which it has a stiffness or damping.
    Bodies without load may keep drifting (a rod that spins slowly between its bearings) and do not count. Nor do
    contact forces: when everything sticks they may vary within their indeterminacy. Nor does the friction of an ideal
    joint, whose ``bound``, (nc,), is not 0: like the joint it stays with its body. ``work.travel`` is updated for a
    step of length ``h``.
    """
    away, load, r, slip, travel = False, 0.0, state.r, state.slip, work.travel
    for i in range(work.values.shape[0]):
        if responses.measures_motion[i]:
            away = away or not abs(work.values[i] - work.anchor[i]) <= drift
    for i in range(slip.shape[0]):
        if bound[i] == 0.0:
            load = max(load, r[i, 0])
    for i in range(slip.shape[0]):
        if r[i, 0] > LOADED * load and bound[i] == 0.0:
            travel[i] += h * slip[i]
            away = away or travel[i] > drift
    for i in range(bushings.off.shape[0]):
        for k in range(bushings.off.shape[1]):
            yields = bushings.law[i, k] > 0.0 or bushings.law[i, BODY + k] > 0.0
            away = away or (yields and not abs(bushings.off[i, k] - bushings.anchor[i, k]) <= drift)
    return away
