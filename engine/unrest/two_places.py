"""Find contacts that press at two places in turn: one contact acts at one of them, and cannot hold at both."""

import itertools

import numpy as np

from engine.arrays import Array, copied
from engine.assembly import Assembly
from engine.kernels.contact_geometry.gaps import find_contacts
from engine.kernels.rotations import rotation_matrix
from engine.unrest.continuation import Continuation

APART = 0.1  # between the unit normals of two places; what rolls or slides on one face turns by far less in a step
OFTEN = 4  # changes from one place to the other, of a continuation in which every step is kept


def held_in_turn(assembly: Assembly, onward: Continuation) -> list[str]:
    """Return the names of the contacts that press now in one direction and then in another.

    Parameters
    ----------
    assembly : Assembly
        As the run left it; nothing is written.
    onward : Continuation
        What the mechanism did then, in every step.
    """
    normals, names = _normals(assembly, onward), []
    for c, name in enumerate(assembly.contact_names):
        pressing = normals[onward.impulse[:, c] > 0.0, c]
        changes = sum(bool(np.linalg.norm(one - other) > APART) for one, other in itertools.pairwise(pressing))
        if changes >= OFTEN:
            names.append(name)
    return names


def _normals(assembly: Assembly, onward: Continuation) -> Array:
    """Return the normals of all contacts in the world, shape (n, nc, 3)."""
    state, work = copied(assembly.state), copied(assembly.work)
    sites, bodies = work.sites, onward.place.shape[1]
    normals = np.empty((len(onward.time), len(assembly.contact_names), 3))
    for at, place in enumerate(onward.place):
        state.x[:bodies] = place[:, :3]
        for body in range(bodies):
            rotation_matrix(place[body, 3:], state.R[body])
        find_contacts(assembly.model.contacts, state.x, state.R, work.gap, sites.point, sites.frame)
        normals[at] = sites.frame[:, 0]
    return normals
