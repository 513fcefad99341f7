"""Contact pairs as arrays: those of joints with clearance, then those the file names."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from engine.assembly.frames import Array, Frame, tangent
from engine.kernels.model import (
    ARC_CYLINDER,
    ARC_PLANE,
    CYLINDER_PLANE,
    GEOMETRY,
    POINT_PLANE,
    Contacts,
    Laws,
)
from engine.mechanism.models import Mechanism

KINDS = {
    "point-plane": POINT_PLANE,
    "arc-plane": ARC_PLANE,
    "cylinder-plane": CYLINDER_PLANE,
    "arc-cylinder": ARC_CYLINDER,
}


@dataclass(frozen=True)
class Pair:
    """A potential contact: two primitives on two bodies.

    Attributes
    ----------
    name : unique; what messages and trajectories call it
    kind : number of the pair of primitives, see `kernels.model`
    a, b : indices of the bodies
    geometry_a, geometry_b : rows of `kernels.contacts`, shape (GEOMETRY,)
    clearance : what is added to the distance to make the gap
    law : (friction, restitution)
    """

    name: str
    kind: int
    a: int
    b: int
    geometry_a: Array
    geometry_b: Array
    clearance: float
    law: tuple[float, float]


def contact_pairs(mechanism: Mechanism, frames: dict[str, Frame]) -> Iterator[Pair]:
    """Yield the contacts of the file's [contacts]."""
    for name, contact in mechanism.contacts.items():
        a, b = contact.sides
        yield Pair(
            name=name,
            kind=KINDS[contact.kind],
            a=frames[a.body].index,
            b=frames[b.body].index,
            geometry_a=_primitive(a, frames),
            geometry_b=_primitive(b, frames),
            clearance=-contact.offset,
            law=mechanism.contact_law(contact),
        )


def contact_arrays(pairs: list[Pair]) -> tuple[Contacts, Laws]:
    """Return the pairs as arrays."""
    laws = np.array([pair.law for pair in pairs], float).reshape(-1, 2)
    contacts = Contacts(
        kind=np.array([pair.kind for pair in pairs], np.int64),
        a=np.array([pair.a for pair in pairs], np.int64),
        b=np.array([pair.b for pair in pairs], np.int64),
        geometry_a=np.array([pair.geometry_a for pair in pairs]).reshape(-1, GEOMETRY),
        geometry_b=np.array([pair.geometry_b for pair in pairs]).reshape(-1, GEOMETRY),
        clearance=np.array([pair.clearance for pair in pairs], float),
        reach=np.array([reach(pair.geometry_a) for pair in pairs], float),
    )
    return contacts, Laws(np.ascontiguousarray(laws[:, 0]), np.ascontiguousarray(laws[:, 1]))


def reach(geometry: Array) -> float:
    """Return how far from its body's centre of mass a side a can touch: its point's distance plus its radius."""
    return float(np.linalg.norm(geometry[:3]) + geometry[9])


def _primitive(side: Any, frames: dict[str, Frame]) -> Array:
    """Return the geometry row of one side of a contact (table in `kernels.contacts`)."""
    frame, g = frames[side.body], np.zeros(GEOMETRY)
    if side.kind == "point":
        g[:3] = frame.point(side.point)
    elif side.kind == "plane":
        n = frame.direction(side.plane.normal)
        g[:3], g[3:6], g[6:9] = frame.point(side.plane.point), n, tangent(n)
    elif side.kind == "arc":
        n, e = frame.direction(side.arc.normal), frame.direction(side.arc.middle)
        e = e - (e @ n) * n
        g[:3], g[3:6], g[6:9] = frame.point(side.arc.centre), n, e / np.linalg.norm(e)
        g[9], g[10] = side.arc.radius, side.arc.half_angle
    else:
        n = frame.direction(side.cylinder.axis)
        g[:3], g[3:6], g[6:9] = frame.point(side.cylinder.point), n, tangent(n)
        g[9] = side.cylinder.radius
    return g
