"""Contact pairs as arrays: first those of joints with clearance, then those in the file's [contacts]."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from engine.arrays import Array, Integers
from engine.assembly.frames import BodyFrame
from engine.assembly.primitives import rows
from engine.assembly.profile_rows import NO_PIECES, profile_pieces
from engine.assembly.remembered import remembered
from engine.assembly.surface_trees import joined_surfaces, surface_tree
from engine.kernels.model import (
    ARC_PLANE,
    CYLINDER_PLANE,
    GEOMETRY,
    ON_BALL,
    ON_DISC,
    ON_EXTRUDED,
    ON_RECTANGLE,
    ON_ROUND,
    ON_SURFACE,
    ON_TURNED,
    POINT_PLANE,
    RING_BORE,
    Contacts,
    Laws,
    Surfaces,
)
from engine.mechanism.contacts import PAIRS
from engine.mechanism.models import Mechanism

_SOLIDS = {
    "cylinder": ON_ROUND,
    "bore": ON_ROUND,
    "disc": ON_DISC,
    "rectangle": ON_RECTANGLE,
    "sphere": ON_BALL,
    "socket": ON_BALL,
    "turned": ON_TURNED,
    "extruded": ON_EXTRUDED,
    "surface": ON_SURFACE,
}
_PLANES = {"point": POINT_PLANE, "sphere": POINT_PLANE, "arc": ARC_PLANE, "cylinder": CYLINDER_PLANE}

KINDS = {
    pair: RING_BORE if pair == "ring-cylinder" else _PLANES[first] if second == "plane" else _SOLIDS[second]
    for pair in PAIRS
    for first, second in [pair.split("-")]
}
"""The number of every supported pair of primitives."""


@dataclass(frozen=True)
class Pair:
    """A potential contact: two primitives on two bodies."""

    name: str  # unique, for messages and trajectories
    kind: int  # number of the pair of primitives, see `kernels.model`
    a: int  # index of a body, as is b
    b: int
    geometry_a: Array  # (GEOMETRY,) row of `kernels.contact_geometry.gaps`, as is geometry_b
    geometry_b: Array
    clearance: float  # added to the distance to give the gap; for a contact of a joint, without the joint's play
    law: tuple[float, float]  # friction and restitution
    pieces: Array = field(default_factory=NO_PIECES.copy)  # (np, PIECE) of side b's profile; empty: it has none
    play: tuple[str, str] | None = None  # the joint and the key of its clearance, for `clearances.add_play`
    surface: Surfaces | None = None  # the tree of side b, if that is a surface


@remembered
def contact_geometry(mechanism: Mechanism, frames: dict[str, BodyFrame]) -> list[tuple[Array, Array, float]]:
    """Return the rows of the two sides of each contact in [contacts], and the length added to their distance."""
    sides = [(contact, *contact.sides) for contact in mechanism.contacts.values()]
    return [rows(contact, frames[a.body], frames[b.body]) for contact, a, b in sides]


@remembered
def contact_profiles(mechanism: Mechanism) -> list[Array]:
    """Return the pieces of side b's profile for each contact in [contacts], shapes (np, PIECE)."""
    return [profile_pieces(contact.sides[1]) for contact in mechanism.contacts.values()]


@remembered
def surface_trees(mechanism: Mechanism, frames: dict[str, BodyFrame]) -> dict[str, Surfaces]:
    """Return the trees of the surfaces in [contacts], by contact; equal surfaces of a body share one tree."""
    sides = {name: contact.sides[1] for name, contact in mechanism.contacts.items()}
    found = {name: (side.body, side.primitive) for name, side in sides.items() if side.kind == "surface"}
    trees = {key: surface_tree(key[1], frames[key[0]]) for key in dict.fromkeys(found.values())}
    return {name: trees[key] for name, key in found.items()}


def contact_pairs(mechanism: Mechanism, frames: dict[str, BodyFrame]) -> Iterator[Pair]:
    """Yield the contacts in [contacts]."""
    geometry, profiles = contact_geometry(mechanism, frames), contact_profiles(mechanism)
    trees = surface_trees(mechanism, frames)
    for (name, contact), (geometry_a, geometry_b, clearance), pieces in zip(
        mechanism.contacts.items(), geometry, profiles, strict=True
    ):
        a, b = contact.sides
        yield Pair(
            name=name,
            kind=KINDS[contact.kind],
            a=frames[a.body].index,
            b=frames[b.body].index,
            geometry_a=geometry_a,
            geometry_b=geometry_b,
            clearance=clearance,
            law=mechanism.contact_law(contact),
            pieces=pieces,
            surface=trees.get(name),
        )


def contact_arrays(pairs: list[Pair], block: Integers) -> tuple[Contacts, Laws]:
    """Return the pairs as arrays; ``block``: the place of each pair of bodies in the system of a step."""
    laws = np.array([pair.law for pair in pairs], float).reshape(-1, 2)
    counts = np.array([len(pair.pieces) for pair in pairs], np.int64)
    root, surfaces = joined_surfaces([pair.surface for pair in pairs])
    contacts = Contacts(
        kind=np.array([pair.kind for pair in pairs], np.int64),
        a=np.array([pair.a for pair in pairs], np.int64),
        b=np.array([pair.b for pair in pairs], np.int64),
        geometry_a=np.array([pair.geometry_a for pair in pairs]).reshape(-1, GEOMETRY),
        geometry_b=np.array([pair.geometry_b for pair in pairs]).reshape(-1, GEOMETRY),
        clearance=np.array([pair.clearance for pair in pairs], float),
        reach=np.array([reach(pair.geometry_a) for pair in pairs], float),
        pair=block,
        profile=np.stack([np.cumsum(counts) - counts, np.cumsum(counts)], axis=1),
        piece=np.concatenate([NO_PIECES, *(pair.pieces for pair in pairs)]),
        surface=root,
        surfaces=surfaces,
    )
    return contacts, Laws(np.ascontiguousarray(laws[:, 0]), np.ascontiguousarray(laws[:, 1]))


def reach(geometry: Array) -> float:
    """Return the largest distance of side a's point, arc or axis from its body's centre of mass, without skins."""
    with np.errstate(over="ignore"):  # an infinite reach is a valid bound: that contact is always near
        return float(np.linalg.norm(geometry[:3]) + geometry[9])
