"""Contacts with friction along and across a grain, see `kernels.grain`."""

from collections.abc import Mapping, Sequence

import numpy as np

from engine.arrays import Array
from engine.assembly.frames import BodyFrame
from engine.mechanism.contacts import Contact
from engine.mechanism.models import Mechanism, refused

GRAIN = 6  # direction in the body's axes, number of the body, lengths of T1 and T2
_NONE = (0.0, 0.0, 0.0, 0.0, 1.0)


def grain_of(mechanism: Mechanism, contact: Contact, frames: Mapping[str, BodyFrame]) -> tuple[float, ...] | None:
    """Return a contact's grain: direction, body, and friction across per friction along it; None without any.

    Raise MechanismError if the two hardly compare, as after `set_values`.
    """
    side, across = contact.grained, mechanism.friction_across(contact)
    along = mechanism.contact_law(contact)[0]
    if side is None or side.grain is None or across is None or across == along:
        return None
    if faults := [*mechanism.grain_faults()]:
        raise refused(mechanism.name, faults, len(faults))
    frame = frames[side.body]
    return *frame.direction(side.grain), float(frame.index), across / along


def grain_arrays(grains: Sequence[tuple[float, ...] | None]) -> tuple[Array, Array]:
    """Return the grains of all contacts, (nc, GRAIN) or (0, GRAIN) without any, and the factors of their friction.

    The factor makes the larger coefficient of the one along the grain.
    """
    if not any(grains):
        return np.zeros((0, GRAIN)), np.ones(len(grains))
    rows = np.array([grain or _NONE for grain in grains])
    ratio, larger = rows[:, 4:], np.maximum(rows[:, 4], 1.0)
    return np.hstack([rows[:, :4], 1.0 / larger[:, None], ratio / larger[:, None]]), larger
