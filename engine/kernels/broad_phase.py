"""Broad phase: find the contacts that are near. All others are so far open that their gaps cannot have closed since.

A gap is a distance, so it closes no faster than its two points approach each other. Each contact has a budget: its gap
at the last update. Each displacement reduces the budget by the distance that points of the two bodies may have moved.
While the budget is positive, the contact is open. The bound is safe, so no result depends on it.
"""

import numpy as np

from engine.jit import inner
from engine.kernels.contact_geometry.boxes import boxes_apart
from engine.kernels.contact_geometry.gaps import find_contact, hull_budget, passes_by
from engine.kernels.contact_geometry.rounds import axes_apart
from engine.kernels.model import BOXES, COUPLED, GEARS, HULLS, ROUNDS


@inner
def body_speeds(twist, speed):
    """Write the speed and angular speed of each body into ``speed``, shape (nb + 1, 2)."""
    for body in range(speed.shape[0] - 1):
        v = twist[body]
        speed[body, 0] = np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
        speed[body, 1] = np.sqrt(v[3] * v[3] + v[4] * v[4] + v[5] * v[5])


@inner
def closing_speed(contacts, broad_phase, i):
    """Return the largest speed at which contact i's gap can close at the current speeds of the bodies."""
    a, b, speed = contacts.a[i], contacts.b[i], broad_phase.speed
    return speed[a, 0] + speed[b, 0] + contacts.reach[i] * speed[a, 1] + broad_phase.lever[i] * speed[b, 1]


@inner
def consume_budget(contacts, twist, dt, broad_phase):
    """Subtract a displacement of ``dt`` times the twists, shape (nb + 1, 6), from the budget of each contact."""
    body_speeds(twist, broad_phase.speed)
    for i in range(contacts.a.shape[0]):
        broad_phase.budget[i] -= dt * closing_speed(contacts, broad_phase, i)


@inner
def update_contact(contacts, state, broad_phase, sites, i, gap):
    """Write the gap, point and frame of contact i at the current pose, and renew its budget."""
    x = state.x
    gap[i] = find_contact(contacts, x, state.R, i, sites.point, sites.frame)
    broad_phase.near[i], broad_phase.budget[i] = True, gap[i]
    if contacts.kind[i] in (GEARS, COUPLED):  # whose coordinates are not bounded by distances
        broad_phase.budget[i] = 0.0
    if passes_by(contacts, sites.frame, i):
        broad_phase.near[i] = False
        broad_phase.budget[i] = gap[i] - contacts.geometry_a[i, 11]
    if contacts.kind[i] == ROUNDS:  # whose features come and go
        broad_phase.budget[i] = axes_apart(contacts, x, state.R, i)
    elif contacts.kind[i] == BOXES:
        broad_phase.budget[i] = boxes_apart(contacts, x, state.R, i)
    elif contacts.kind[i] == HULLS:
        broad_phase.budget[i] = hull_budget(contacts.hulls, contacts, x, state.R, i)
    a, b = contacts.a[i], contacts.b[i]
    d0, d1, d2 = x[a, 0] - x[b, 0], x[a, 1] - x[b, 1], x[a, 2] - x[b, 2]
    lever = np.sqrt(d0 * d0 + d1 * d1 + d2 * d2) + contacts.reach[i]
    broad_phase.lever[i] = lever + 2 * abs(gap[i]) + abs(contacts.clearance[i])  # a skin is part of the clearance


@inner
def find_near_contacts(contacts, state, broad_phase, sites, dt, distance, gap):
    """Update the contacts whose gap could be within ``distance`` after ``dt`` at the speeds ``broad_phase.speed``.

    The sites are written for near contacts only. For the others ``gap``, (nc,), receives a lower bound.
    """
    for i in range(gap.shape[0]):
        gap[i] = broad_phase.budget[i]
        broad_phase.near[i] = False
        within = distance + dt * closing_speed(contacts, broad_phase, i)
        if not broad_phase.budget[i] > within:  # true for NaN as well
            update_contact(contacts, state, broad_phase, sites, i, gap)


@inner
def find_contacts_within(contacts, state, broad_phase, sites, distance, gap):
    """Update also the contacts whose gap could be within ``distance``, at the pose of the last `find_near_contacts`."""
    for i in range(gap.shape[0]):
        if not broad_phase.near[i] and not broad_phase.budget[i] > distance:
            update_contact(contacts, state, broad_phase, sites, i, gap)
