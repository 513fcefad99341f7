"""Couplings of joint coordinates: contacts that act on as many bodies as their joints have.

The coordinate of a coupling is the sum of factor times coordinate over its terms. Its two contacts keep it within the
backlash, one on each flank. A term is a SLIDE or a TURN with the geometry of `kernels.bilateral`; an arm has no part in
it, so that the force of a contact is that on the first coordinate, a torque if that is an angle.
"""

import numpy as np

from engine.friction.blocks import BODY, ROW
from engine.jit import inner, not_inlined
from engine.kernels.model import SLIDE
from engine.kernels.vectors import dot, vector_product, world_direction


@inner
def _place(x, R, body, row, k):
    """Return the world position of the body's point ``row[k : k + 3]``."""
    d = world_direction(R, body, row, k)
    return (x[body, 0] + d[0], x[body, 1] + d[1], x[body, 2] + d[2])


@not_inlined
def coupled_gap(contacts, x, R, i):
    """Return the gap of contact i, on a flank of a coupling. An angle counts its full turns from where it was last."""
    terms, c = contacts.terms, contacts.coupling[i]
    total = 0.0
    for k in range(terms.first[c], terms.first[c + 1]):
        a, b, row = terms.body[k, 0], terms.body[k, 1], terms.geometry[k]
        t = world_direction(R, a, row, 3)
        if terms.kind[k] == SLIDE:
            p, q = _place(x, R, a, row, 0), _place(x, R, b, row, 6)
            value = t[0] * (q[0] - p[0]) + t[1] * (q[1] - p[1]) + t[2] * (q[2] - p[2]) - terms.start[k]
        else:
            d, e = world_direction(R, a, row, 0), world_direction(R, b, row, 6)
            value = np.arctan2(dot(t, vector_product(d, e)), dot(d, e))
            value -= 2 * np.pi * np.round((value - terms.angle[k]) / (2 * np.pi))
            terms.angle[k] = value
        total += terms.factor[k] * value
    return contacts.clearance[i] + contacts.flank[i] * total


@not_inlined
def coupled_velocity(contacts, x, R, twist, i):
    """Return the rate of contact i's gap for the twists, shape (nb + 1, 6)."""
    terms, c, total = contacts.terms, contacts.coupling[i], 0.0
    for k in range(terms.first[c], terms.first[c + 1]):
        t = world_direction(R, terms.body[k, 0], terms.geometry[k], 3)
        for side in range(2):
            body = terms.body[k, side]
            if body >= x.shape[0] - 1:
                continue
            n, m = _effect(terms, x, R, k, body, t)
            for j in range(3):
                spin = R[body, j, 0] * twist[body, 3] + R[body, j, 1] * twist[body, 4] + R[body, j, 2] * twist[body, 5]
                total += (2 * side - 1) * terms.factor[k] * (n[j] * twist[body, j] + m[j] * spin)
    return contacts.flank[i] * total


@inner
def _effect(terms, x, R, k, body, t):
    """Return the force and the torque on a body of a force of 1 along term k, whose world direction is t."""
    if terms.kind[k] != SLIDE:
        return (0.0, 0.0, 0.0), t
    p = _place(x, R, terms.body[k, 1], terms.geometry[k], 6)
    return t, vector_product((p[0] - x[body, 0], p[1] - x[body, 1], p[2] - x[body, 2]), t)


@not_inlined
def coupled_rows(bodies, contacts, x, R, i, rows, j):
    """Write the rows of contact i, on a flank of a coupling, as contact j of a problem: it has only a normal."""
    terms, c, root, G = contacts.terms, contacts.coupling[i], bodies.inverse_root, rows.G[j]
    for s in range(rows.node.shape[1]):
        body = terms.member[c, s]
        rows.node[j, s] = bodies.node[body] if body >= 0 else -1
        for t in range(rows.node.shape[1]):
            rows.pair[j, s, t] = terms.pair[c, s, t]
        for n in range(ROW):
            G[0, ROW * s + n] = G[1, ROW * s + n] = G[2, ROW * s + n] = 0.0
    for k in range(terms.first[c], terms.first[c + 1]):
        t = world_direction(R, terms.body[k, 0], terms.geometry[k], 3)
        for side in range(2):
            body, s = terms.body[k, side], terms.place[k, side]
            if s < 0:
                continue
            n, m = _effect(terms, x, R, k, body, t)
            f = (2 * side - 1) * contacts.flank[i] * terms.factor[k]
            for a in range(3):
                G[0, ROW * s + a] += f * n[a] / np.sqrt(bodies.mass[body])
                # the torque in body axes, times L^-1
                turned = 0.0
                for b in range(a + 1):
                    turned += root[body, a, b] * (R[body, 0, b] * m[0] + R[body, 1, b] * m[1] + R[body, 2, b] * m[2])
                G[0, ROW * s + BODY // 2 + a] += f * turned
