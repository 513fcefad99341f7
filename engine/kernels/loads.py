"""Forces and torques on the bodies: gravity, springs and dampers along lines and about axes, loads with a time law.

Time laws are factors of loads, and targets of prescribed motions.
"""

import numpy as np

from engine.jit import inner, kernel, not_inlined
from engine.kernels.bushings import add_bushings, bushing_energy
from engine.kernels.coordinates import position, rotation, speed_along, spin_along
from engine.kernels.model import ANGLE, ANGULAR_VELOCITY
from engine.kernels.vectors import times, to_world, turn_to_world, twist_angle


@kernel
def time_law(laws, i, t):
    """Return law i at time t: its cubic piece, constant before the first and after the last, plus its sine.

    ``t`` is the time since the start of the run.
    """
    t = _since(laws, i, t)
    if t == -np.inf:
        t = 0.0
    k = _piece(laws, i, t)
    s = max(t - laws.time[k], 0.0) if k < laws.first[i + 1] - 1 else 0.0
    c, a, w, phi = laws.piece[k], laws.sine[i, 0], laws.sine[i, 1], laws.sine[i, 2]
    return c[0] + s * (c[1] + s * (c[2] + s * c[3])) + a * (np.sin(w * t + phi) - np.sin(phi))


@kernel
def time_law_rate(laws, i, t):
    """Return the right-hand derivative of law i at time t."""
    t = _since(laws, i, t)
    if t == -np.inf:
        return 0.0
    k = _piece(laws, i, t)
    s, c, a, w, phi = t - laws.time[k], laws.piece[k], laws.sine[i, 0], laws.sine[i, 1], laws.sine[i, 2]
    rate = c[1] + s * (2 * c[2] + 3 * s * c[3]) if k < laws.first[i + 1] - 1 and s >= 0.0 else 0.0
    return rate + a * w * np.cos(w * t + phi)


@not_inlined
def table_at(laws, i, x):
    """Return law i, a table, at x: constant before its first point and after its last."""
    k = _piece(laws, i, x)
    d = max(x - laws.time[k], 0.0) if k < laws.first[i + 1] - 1 else 0.0
    c = laws.piece[k]
    return c[0] + d * (c[1] + d * (c[2] + d * c[3]))


@not_inlined
def table_integral(laws, i, x):
    """Return the integral of law i, a table, from its first point to x."""
    first, last, total = laws.first[i], laws.first[i + 1] - 1, 0.0
    if x < laws.time[first]:
        return laws.piece[first, 0] * (x - laws.time[first])
    for k in range(first, last):
        c, s = laws.piece[k], min(x, laws.time[k + 1]) - laws.time[k]
        if s > 0.0:
            total += s * (c[0] + s * (c[1] / 2 + s * (c[2] / 3 + s * c[3] / 4)))
    return total + laws.piece[last, 0] * max(x - laws.time[last], 0.0)


@inner
def smooth_change(laws, i, t, h):
    """Return the change of law i's rate from t to t + h without its jumps: the integral of its second derivative."""
    t = _since(laws, i, t)
    if t == -np.inf:
        return 0.0
    a, w, phi = laws.sine[i, 0], laws.sine[i, 1], laws.sine[i, 2]
    change, last = a * w * (np.cos(w * (t + h) + phi) - np.cos(w * t + phi)), laws.first[i + 1] - 1
    for k in range(_piece(laws, i, t), last):  # the law is constant from its last piece on
        c, start = laws.piece[k], laws.time[k]
        first, end = max(t, start) - start, min(t + h, laws.time[k + 1]) - start
        if end > first:
            change += (end - first) * (2 * c[2] + 3 * c[3] * (first + end))
        if t + h <= laws.time[k + 1]:
            break
    return change


@inner
def goes_on(laws, i, t):
    """Return whether law i has begun by time t, and will still change."""
    t = _since(laws, i, t)
    if t == -np.inf:
        return False
    first, last = laws.first[i], laws.first[i + 1] - 1
    changes = laws.sine[i, 0] != 0.0
    for k in range(first, last):
        c = laws.piece[k]
        later = t < laws.time[k + 1] and (c[1] != 0.0 or c[2] != 0.0 or c[3] != 0.0)
        changes = changes or later
    return changes


@inner
def _since(laws, i, t):
    """Return the time since law i's phase began; -inf before it has begun."""
    return t - laws.begun[laws.since[i]]


@inner
def _piece(laws, i, t):
    """Return the last piece of law i that has begun by time t, by bisection."""
    k, end = laws.first[i], laws.first[i + 1]
    while end - k > 1:
        middle = (k + end) // 2
        if laws.time[middle] <= t:
            k = middle
        else:
            end = middle
    return k


@kernel
def apply_loads(bodies, loads, time_laws, state, phase, t, wrench, vectors):
    """Write the force and the torque about the centre of mass of each body, in world axes, (nb + 1, 6).

    Some forces and torques act only in some phases. The time t is that since the start of the run; ``vectors``, (2, 3),
    is workspace.
    """
    a, b = vectors[0], vectors[1]
    for body in range(wrench.shape[0]):
        for k in range(3):
            wrench[body, k] = 0.0
            if body < bodies.mass.shape[0]:
                wrench[body, k] = bodies.mass[body] * loads.gravity[k]
            wrench[body, 3 + k] = 0.0
    _linear_springs(loads, time_laws, state, wrench, a, b)
    _torsion_springs(loads, time_laws, state, wrench, a, b)
    _forces_and_torques(loads, time_laws, state, phase, t, wrench, a, b)
    if loads.bushings.body.shape[0] > 0:
        add_bushings(loads.bushings, state, wrench)


@kernel
def potential_energy(bodies, loads, laws, state):
    """Return the potential energy of gravity (0 at the world's origin) and springs.

    That of a spring is 0 where it exerts no force, or where its table begins.

    Forces and torques of the file are not included: loads that depend on phase, time or body axes have no potential.
    The same holds for a spring with actions. The couple of a torsion spring derives from this energy only while its
    bodies turn about its axis alone.
    """
    energy = 0.0
    for body in range(bodies.mass.shape[0]):
        for k in range(3):
            energy -= bodies.mass[body] * loads.gravity[k] * state.x[body, k]
    first, lines = loads.action_first, loads.spring_body.shape[0]
    for i in range(lines):
        if first[i] < first[i + 1]:
            continue
        a, b, point = loads.spring_body[i, 0], loads.spring_body[i, 1], loads.spring_point[i]
        square = 0.0
        for k in range(3):
            d = state.x[b, k] - state.x[a, k]
            for j in range(3):
                d += state.R[b, k, j] * point[3 + j] - state.R[a, k, j] * point[j]
            square += d * d
        force = _elastic_force(loads.spring_law[i], np.sqrt(square))
        if loads.spring_table[i, 0] >= 0:
            energy -= table_integral(laws, loads.spring_table[i, 0], np.sqrt(square))
        elif force != 0.0:  # not a damper
            energy += 0.5 * force * force / loads.spring_law[i, 0]
    for i in range(loads.torsion_body.shape[0]):
        if first[lines + i] < first[lines + i + 1]:
            continue
        angle = _torsion_angle(loads, state, i) - loads.torsion_law[i, 1]
        energy += 0.5 * loads.torsion_law[i, 0] * angle * angle
        if loads.torsion_table[i, 0] >= 0:
            energy -= table_integral(laws, loads.torsion_table[i, 0], _torsion_angle(loads, state, i))
    return energy + bushing_energy(loads.bushings, state)


@inner
def _elastic_force(law, length):
    """Return k (free length - length) + preload; 0 in the direction in which a one-sided spring does not act."""
    force = law[0] * (law[1] - length) + law[3]
    return force if law[4] * force >= 0.0 else 0.0


@inner
def _linear_springs(loads, laws, state, wrench, p, q):
    """Apply each spring's force at its two points, or distribute it by its actions."""
    for i in range(loads.spring_body.shape[0]):
        force, d0, d1, d2 = spring_force(loads, laws, state, i, p, q)
        if _acts_elsewhere(loads, state, i, force, wrench, p, q):
            continue
        _add_force(state.x, loads.spring_body[i, 1], q, force * d0, force * d1, force * d2, wrench)
        _add_force(state.x, loads.spring_body[i, 0], p, -force * d0, -force * d1, -force * d2, wrench)


@inner
def spring_force(loads, laws, state, i, p, q):
    """Return the elastic force - c d(length)/dt of spring i, and its direction; write its two points into ``p``, ``q``.

    A one-sided spring that has lifted off does not damp.
    """
    a, b = loads.spring_body[i, 0], loads.spring_body[i, 1]
    to_world(state.x, state.R, a, loads.spring_point[i], 0, p)
    to_world(state.x, state.R, b, loads.spring_point[i], 3, q)
    d0, d1, d2 = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    length = np.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
    if length == 0.0:
        return 0.0, 0.0, 0.0, 0.0
    d0, d1, d2 = d0 / length, d1 / length, d2 / length
    rate = speed_along(state.x, state.R, state.v, b, q, d0, d1, d2) - speed_along(
        state.x, state.R, state.v, a, p, d0, d1, d2
    )
    law = loads.spring_law[i]
    elastic = _elastic_force(law, length)
    force = elastic - law[2] * rate
    if loads.spring_table[i, 0] >= 0:
        elastic = table_at(laws, loads.spring_table[i, 0], length)
        force += elastic
    if loads.spring_table[i, 1] >= 0:
        force -= table_at(laws, loads.spring_table[i, 1], rate)
    if law[4] != 0.0 and (elastic == 0.0 or law[4] * force < 0.0):
        force = 0.0
    return force, d0, d1, d2


@inner
def _torsion_springs(loads, laws, state, wrench, axis, p):
    """Apply each torsion spring's torque to body b and its opposite to a, or distribute it by its actions."""
    for i in range(loads.torsion_body.shape[0]):
        a, b = loads.torsion_body[i, 0], loads.torsion_body[i, 1]
        torque = spring_torque(loads, laws, state, i, axis)
        if _acts_elsewhere(loads, state, loads.spring_body.shape[0] + i, torque, wrench, p, axis):
            continue
        for k in range(3):
            wrench[b, 3 + k] += torque * axis[k]
            wrench[a, 3 + k] -= torque * axis[k]


@inner
def spring_torque(loads, laws, state, i, axis):
    """Return -k (angle - free angle) - c rate of torsion spring i; write its world axis, fixed in a, into ``axis``."""
    a, b, law = loads.torsion_body[i, 0], loads.torsion_body[i, 1], loads.torsion_law[i]
    turn_to_world(state.R, a, loads.torsion_axis[i], 0, axis)
    rate = spin_along(state.R, state.v, b, axis) - spin_along(state.R, state.v, a, axis)
    torque = -law[0] * (_torsion_angle(loads, state, i) - law[1]) - law[2] * rate
    if loads.torsion_table[i, 0] >= 0:
        torque += table_at(laws, loads.torsion_table[i, 0], _torsion_angle(loads, state, i))
    if loads.torsion_table[i, 1] >= 0:
        torque -= table_at(laws, loads.torsion_table[i, 1], rate)
    return torque


@inner
def _torsion_angle(loads, state, i):
    """Return the angle of body b relative to body a about spring i's axis."""
    a, b, n = loads.torsion_body[i, 0], loads.torsion_body[i, 1], loads.torsion_axis[i]
    angle = twist_angle(state.p[a], times(state.p[b], loads.torsion_turn[i]), n[0], n[1], n[2])
    turns = np.floor((angle - loads.torsion_law[i, 3]) / (2 * np.pi) + 0.5)  # the branch nearest to the initial angle
    return angle - 2 * np.pi * turns


@inner
def _forces_and_torques(loads, time_laws, state, phase, t, wrench, p, f):
    """Apply the forces and torques of the current phase, each multiplied by its time law."""
    for i in range(loads.force_body.shape[0]):
        if not loads.force_phase[i, phase]:
            continue
        body, factor = loads.force_body[i], 1.0
        if loads.force_over[i] >= 0:
            factor = table_at(time_laws, loads.force_law[i], _measured(loads, state, loads.force_over[i], p))
        elif loads.force_law[i] >= 0:
            factor = time_law(time_laws, loads.force_law[i], t)
        _add_load(state, body, loads.force_vector[i], loads.force_in_body[i], factor, wrench, p, f)
        if loads.force_against[i] >= 0:
            _react(loads, state, i, factor, wrench, p, f)


@not_inlined
def _react(loads, state, i, factor, wrench, p, f):
    """Apply the opposite of force or torque i to the body against which it acts, at the same place."""
    body, against, row = loads.force_body[i], loads.force_against[i], loads.force_vector[i]
    to_world(state.x, state.R, body, row, 0, p)
    for part in range(2):
        k = 3 + 3 * part
        f[0], f[1], f[2] = row[k], row[k + 1], row[k + 2]
        if loads.force_in_body[i]:
            turn_to_world(state.R, body, row, k, f)
        if part == 0:
            _add_force(state.x, against, p, -factor * f[0], -factor * f[1], -factor * f[2], wrench)
        else:
            for k in range(3):
                wrench[against, 3 + k] -= factor * f[k]


@not_inlined
def _measured(loads, state, j, p):
    """Return the coordinate or speed j that laws depend on; ``p`` is workspace. An angle counts its full turns."""
    kind, body, row = loads.over_kind[j], loads.over_body[j], loads.over_point[j]
    if kind in (ANGLE, ANGULAR_VELOCITY):
        value = rotation(kind, body, row, state, loads.over_value[j], p)
        loads.over_value[j] = value
    else:
        value = position(kind, body, row, state, p, loads.over_work)
    return value + loads.over_offset[j]


@inner
def _acts_elsewhere(loads, state, spring, size, wrench, p, f):
    """Apply the actions of a spring, multiplied by its force or torque; return False if it has none."""
    first, end = loads.action_first[spring], loads.action_first[spring + 1]
    for k in range(first, end):
        _add_load(state, loads.action_body[k], loads.action_vector[k], True, size, wrench, p, f)
    return first < end


@inner
def _add_load(state, body, row, in_body, factor, wrench, p, f):
    """Add a factor times a force at a point and a torque, given as a row of ``force_vector``."""
    to_world(state.x, state.R, body, row, 0, p)
    for part in range(2):
        k = 3 + 3 * part
        f[0], f[1], f[2] = row[k], row[k + 1], row[k + 2]
        if in_body:
            turn_to_world(state.R, body, row, k, f)
        if part == 0:
            _add_force(state.x, body, p, factor * f[0], factor * f[1], factor * f[2], wrench)
        else:
            for k in range(3):
                wrench[body, 3 + k] += factor * f[k]


@inner
def _add_force(x, body, p, f0, f1, f2, wrench):
    d0, d1, d2 = p[0] - x[body, 0], p[1] - x[body, 1], p[2] - x[body, 2]
    wrench[body, 0] += f0
    wrench[body, 1] += f1
    wrench[body, 2] += f2
    wrench[body, 3] += d1 * f2 - d2 * f1
    wrench[body, 4] += d2 * f0 - d0 * f2
    wrench[body, 5] += d0 * f1 - d1 * f0
