"""Record a run: one row of numbers per step, in rows allocated beforehand.

A row holds, in this order: time, step, kinetic energy, potential energy; for each moving body its position (3),
quaternion (4), velocity (3) and body-frame angular velocity (3); for each contact its gap, impulse (N, T1, T2) and
whether it is in the index set; and each response. ``rows[0, 0]`` is the number of rows written so far, from ``rows[1]``
on.
"""

from engine.jit import kernel
from engine.kernels.contact_geometry.gaps import find_contact
from engine.kernels.energy import kinetic_energy
from engine.kernels.grain import lengths
from engine.kernels.loads import potential_energy

HEAD, BODY, CONTACT = 4, 13, 5


def row_length(bodies: int, contacts: int, responses: int) -> int:
    """Return the length of a row."""
    return HEAD + BODY * bodies + CONTACT * contacts + responses


@kernel
def record(model, state, work, t, h, rows):
    """Write the current state as a row; if the rows are full, return True and write nothing."""
    i = int(rows[0, 0]) + 1
    if i >= rows.shape[0]:
        return True
    row, nb = rows[i], model.bodies.mass.shape[0]
    row[0], row[1] = t, h
    row[2] = kinetic_energy(model.bodies, state.v)
    row[3] = potential_energy(model.bodies, model.loads, model.time_laws, state)
    at = HEAD
    for body in range(nb):
        for k in range(3):
            row[at + k], row[at + 7 + k], row[at + 10 + k] = state.x[body, k], state.v[body, k], state.v[body, 3 + k]
        for k in range(4):
            row[at + 3 + k] = state.p[body, k]
        at += BODY
    for c in range(state.gap.shape[0]):
        row[at] = find_contact(model.contacts, state.x, state.R, c, work.sites.point, work.sites.frame)
        row[3] += 0.5 * model.contacts.stiffness[c] * min(row[at], 0.0) ** 2
        first, second = lengths(model.contacts, c)
        row[at + 1], row[at + 2], row[at + 3] = state.r[c, 0], first * state.r[c, 1], second * state.r[c, 2]
        row[at + 4] = 1.0 if work.active[c] else 0.0
        at += CONTACT
    for k in range(work.values.shape[0]):
        row[at + k] = work.values[k]
    rows[0, 0] = i
    return False
