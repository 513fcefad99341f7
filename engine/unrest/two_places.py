"""Find contacts that press alternately at two places: a contact acts at one of them and cannot hold at both."""

import itertools

import numpy as np

from engine.arrays import Array, copied
from engine.assembly import Assembly
from engine.kernels.contact_geometry.gaps import find_contacts
from engine.kernels.rotations import rotation_matrix
from engine.unrest.continuation import Continuation

APART = 0.1  # between the unit normals of two places; a body that rolls or slides on one face turns far less in a step
OFTEN = 4  # changes from one place to the other within a continuation that keeps every step


def held_in_turn(assembly: Assembly, onward: Continuation) -> list[str]:
    """Return the names of the contacts that press alternately in two different directions.

    `onward` must contain every step. `assembly` is as the run left it, and is not written to.
    """
    normals, names = _normals(assembly, onward), []
    for c, name in enumerate(assembly.contact_names):
        pressing = normals[onward.impulse[:, c] > 0.0, c]
        changes = sum(bool(np.linalg.norm(one - other) > APART) for one, other in itertools.pairwise(pressing))
        if changes >= OFTEN:
            names.append(name)
    return names


def _normals(assembly: Assembly, onward: Continuation) -> Array:
    """Return the normals of all contacts in world axes, shape (n, nc, 3)."""
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
