"""Measure the responses after each step, and keep the values to report.

================  ==================================  =====================================================
kind              body                                point, from the centre of mass in body axes
================  ==================================  =====================================================
POSITION          from, to, direction                 from (0:3), its axis or 0 (3:6), to (6:9), direction (9:12)
VELOCITY          as above; rate of the position
ANGLE             relative to, body                   axis (3:6); inverse of the initial rotation (6:10)
ANGULAR_VELOCITY  as above                            axis (3:6)
GAP               contacts: first, number             their smallest gap
SPRING_FORCE      linear spring
SPRING_TORQUE     torsion spring
TIME
DERIVED           NaN here
CONTACT_IMPULSE   contacts; normal impulse so far     their sum, as in the next two
CONTACT_FORCE     contacts
FRICTION_FORCE    contacts
MOTION_TRAVEL     bilateral row
MOTION_WORK       bilateral row; work so far
MOTION_FORCE      bilateral row; the torque of a rotation
IMPULSE           response, a force; its integral so far
MEAN              response; its mean so far
FRICTION_WORK     contacts; what friction took so far their sum
BOUNCES           contacts; how often they opened     gap from which they are open (0)
BUSHING_FORCE     bushing, 0, direction               direction, or 0: the magnitude (9:12)
BUSHING_TORQUE    as above; about its point
JOINT_FORCE       first contact, number, direction    sign of an impulse (0); direction, or 0: the magnitude (9:12)
================  ==================================  =====================================================
"""

import numpy as np

from engine.jit import inner, kernel, not_inlined
from engine.kernels.bushings import bushing_effort
from engine.kernels.contact_geometry.gaps import find_contact
from engine.kernels.coordinates import position, rotation
from engine.kernels.grain import lengths
from engine.kernels.loads import spring_force, spring_torque
from engine.kernels.model import (
    ANGLE,
    ANGULAR_VELOCITY,
    BOUNCES,
    BUSHING_FORCE,
    BUSHING_TORQUE,
    CONTACT_FORCE,
    CONTACT_IMPULSE,
    DERIVED,
    END,
    FRICTION_FORCE,
    FRICTION_WORK,
    GAP,
    IMPULSE,
    JOINT_FORCE,
    MEAN,
    MOTION_FORCE,
    MOTION_TRAVEL,
    MOTION_WORK,
    PEAK,
    SPRING_FORCE,
    SPRING_TORQUE,
    TIME,
)
from engine.kernels.vectors import turn_to_world

SHARE = 0.1  # of a force, from which an impact counts
ROUNDING = 1e-9  # share of a step by which a window may begin before it
SHORT = 0.1  # share of the time of a mean, below which a step resolves it


@kernel
def measure(model, state, sites, rows, values, vectors, instant):
    """Write every response at the end of a step into ``values``, (nr,).

    On entry, ``values`` holds those of the previous step, or the offsets at the start: an angle counts its full turns
    from there, an impulse is added up, and a mean force follows the force like a load cell behind a filter of first
    order. ``sites`` are written where a gap is measured, ``vectors``, (2, 3), is workspace, and
    ``instant`` holds the time at the end of the step and its length; ``rows`` is the state of the bilateral rows.
    """
    responses, contacts, loads = model.responses, model.contacts, model.loads
    t, h = instant
    frame, p, q = sites.frame, vectors[0], vectors[1]
    for i in range(values.shape[0]):
        kind, body, row = responses.kind[i], responses.body[i], responses.point[i]
        if kind == GAP:
            value = _smallest_gap(contacts, state, body, sites)
        elif kind == SPRING_FORCE:
            value = spring_force(loads, model.time_laws, state, body[0], p, q)[0]
        elif kind == SPRING_TORQUE:
            value = spring_torque(loads, model.time_laws, state, body[0], p)
        elif kind == TIME:
            value = t
        elif kind == DERIVED:
            value = np.nan
        elif kind == CONTACT_IMPULSE:
            value = values[i] + _sum(contacts, state.r, body, False)
        elif kind == CONTACT_FORCE:
            value = _sum(contacts, state.r, body, False) / h
        elif kind == FRICTION_FORCE:
            value = _sum(contacts, state.r, body, True) / h
        elif kind == MOTION_FORCE:
            value = rows.force[body[0]]
        elif kind == MOTION_WORK:
            value = values[i] + rows.work[body[0]]
        elif kind == MOTION_TRAVEL:
            acts = model.bilateral.acts[body[0]]  # afterwards it stays as it was
            value = rows.target[1, body[0]] - model.bilateral.offset[body[0]] if acts else values[i]
        elif kind in (IMPULSE, MEAN, BOUNCES, FRICTION_WORK):
            value = values[i]  # see `accumulate`
        elif kind in (BUSHING_FORCE, BUSHING_TORQUE):
            turn_to_world(state.R, body[2], row, 9, p)
            value = bushing_effort(loads.bushings, body[0], kind == BUSHING_TORQUE, p)
        elif kind == JOINT_FORCE:
            value = _joint_impulse(body, row, state, frame, p, q) / h
        elif kind in (ANGLE, ANGULAR_VELOCITY):
            value = rotation(kind, body, row, state, values[i] - responses.offset[i], p)
        else:
            value = position(kind, body, row, state, p, q)
        if responses.averaged_over[i] > 0.0:
            value = values[i] - (value - values[i]) * np.expm1(-h / responses.averaged_over[i])
        values[i] = value + responses.offset[i]


@inner
def accumulate(model, state, work, t, h):
    """Add the step of length ``h`` that ended at time ``t`` to the impulses, means and counts, in ``work.values``.

    A force is constant in a step, and anything else changes linearly from its value at the start of the step.
    """
    responses, values, previous, begun = model.responses, work.values, work.previous, model.time_laws.begun
    for i in range(values.shape[0]):
        kind, j = responses.kind[i], responses.body[i, 0]
        if kind == BOUNCES:
            gap = _smallest_gap(model.contacts, state, responses.body[i], work.sites)
            work.touched[i] = work.touched[i] or _sum(model.contacts, state.r, responses.body[i], False) > 0.0
            if work.touched[i] and gap > responses.point[i, 0]:
                work.touched[i] = False
                values[i] += 1.0
        elif kind == FRICTION_WORK:
            for k in range(j, j + responses.body[i, 1]):
                values[i] += work.rubbed[k]
        elif kind in (IMPULSE, MEAN):
            first = begun[responses.from_phase[i]] + responses.window[i, 0]
            last = begun[responses.from_phase[i]] + responses.window[i, 1]
            a, b = max(t - h, first), min(t, last)
            if not a < b:
                if kind == MEAN and not t > first:
                    values[i] = np.nan  # there is none before its window
                continue
            value = values[j]
            if responses.kind[j] < CONTACT_FORCE:
                value = previous[j] + (values[j] - previous[j]) * (0.5 * (a + b) - t + h) / h
            if kind == IMPULSE:
                values[i] += value * (b - a)
            else:
                before = a - first
                values[i] = (
                    value if not before > ROUNDING * h else values[i] + (value - values[i]) * (b - a) / (b - first)
                )


@not_inlined
def _smallest_gap(contacts, state, body, sites):
    """Return the smallest gap of the contacts of a response; their sites are written."""
    value = np.inf
    for j in range(body[0], body[0] + body[1]):
        gap = find_contact(contacts, state.x, state.R, j, sites.point, sites.frame)
        value = value if gap > value else gap  # NaN is smaller than all before it
    return value


@inner
def _sum(contacts, r, body, friction):
    """Return the sum of the normal impulses of the contacts of a response, or of the sizes of those of friction."""
    total = 0.0
    for j in range(body[0], body[0] + body[1]):
        first, second = lengths(contacts, j)
        size = np.hypot(first * r[j, 1], second * r[j, 2]) if friction else r[j, 0]
        total = size if j == body[0] else total + size
    return total


@inner
def _joint_impulse(body, row, state, frame, total, way):
    """Return the resultant of a joint's contact impulses on its second side: its magnitude or a component."""
    R, r = state.R, state.r
    total[0], total[1], total[2] = 0.0, 0.0, 0.0
    for i in range(body[0], body[0] + body[1]):
        for k in range(3):
            for j in range(3):
                total[k] += row[0] * r[i, j] * frame[i, j, k]
    turn_to_world(R, body[2], row, 9, way)
    if way[0] == 0.0 and way[1] == 0.0 and way[2] == 0.0:
        return np.sqrt(total[0] ** 2 + total[1] ** 2 + total[2] ** 2)
    return total[0] * way[0] + total[1] * way[1] + total[2] * way[2]


@kernel
def update_reported(responses, work, phase, h):
    """Update the reported values after a step ``h``, from the values at its end and ``previous``, those at its start.

    ``reported`` is NaN before the first step, and until the event at which the response is read has happened; ``peak``,
    the peak so far of the response whose peak is searched for, is NaN before the first step. ``at_impact`` marks the
    responses whose force, or the force at whose peak they are read, is that of an impact: it depends on the step.
    """
    values, previous, reported, peak = work.values, work.previous, work.reported, work.peak
    for i in range(reported.shape[0]):
        limit, side = responses.limit[i, 0], responses.limit[i, 1]
        if phase < responses.from_phase[i] or phase > responses.to_phase[i]:
            continue
        j = responses.trigger[i]
        struck = _at_impact(responses, values[i], work.impact[0], i, h)
        if responses.at[i] == END:
            reported[i], work.at_impact[i] = values[i], struck
        elif responses.at[i] == PEAK:
            if not side * peak[i] >= side * values[j]:
                peak[i], reported[i] = values[j], values[i]
                work.at_impact[i] = struck or _at_impact(responses, values[j], work.impact[0], j, h)
            if responses.kind[j] < CONTACT_FORCE and side * previous[j] > side * peak[i]:
                # the start of the phase counts, but not the forces of the step before it
                peak[i], reported[i] = previous[j], previous[i]
                work.at_impact[i] = _at_impact(responses, previous[i], work.impact[1], i, h)
        elif np.isnan(reported[i]):
            before, after = side * (previous[j] - limit), side * (values[j] - limit)
            if before > 0.0:
                reported[i] = previous[i]
                work.at_impact[i] = _at_impact(responses, previous[i], work.impact[1], i, h)
            elif after > 0.0:  # the crossing, and the value measured there, by linear interpolation
                reported[i] = previous[i] + before / (before - after) * (values[i] - previous[i])
                work.at_impact[i] = struck


@inner
def _at_impact(responses, value, impact, i, h):
    """Return whether response i is a force to which an impact contributes, so that it depends on the step.

    A mean over much more than the step does not: it is the impulse over that time.
    """
    force = responses.kind[i] >= CONTACT_FORCE and responses.kind[i] != DERIVED
    if not force or h < SHORT * responses.averaged_over[i]:
        return False
    return impact > SHARE * abs(value)
