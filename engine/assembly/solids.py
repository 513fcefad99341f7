"""Contacts of two solids that touch at several points at once: each a contact of one feature, named CONTACT.end_a0, ...

Two convex solids are nearest to each other at an end or a rim of one of them, or where two lines cross. So a capsule
lies with its two ends on a plane, and two parallel rollers touch at both ends of what they have in common.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from engine.arrays import Array
from engine.assembly.contacts import KINDS, NO_PIECES, Pair, geometry_row, profile_pieces, row_b
from engine.assembly.frames import BodyFrame, tangent
from engine.assembly.table_cache import cached
from engine.kernels.contact_geometry.rounds import CROSSING, LAST, LOWER
from engine.kernels.model import ROUNDS
from engine.mechanism.contacts import OUTLINES, SEVERAL, Side
from engine.mechanism.models import Mechanism

SHALLOW = 1e-5  # share of its radius; a rim that is deeper in the other solid is pushed out of any face
WAYS = ("a", "b"), ("b", "a")


@dataclass(frozen=True)
class _Feature:
    """A feature of one side against the other side."""

    name: str
    kind: int
    sides: tuple[str, str]
    rows: tuple[Array, Array]
    skin: float
    pieces: Array


def solid_pairs(mechanism: Mechanism, frames: dict[str, BodyFrame]) -> Iterator[Pair]:
    """Yield the contacts of all pairs of solids in [contacts] that touch at several points, but for two profiles."""
    for name, features in _features(mechanism, frames).items():
        contact = mechanism.contacts[name]
        sides, law = {"a": contact.a, "b": contact.b}, mechanism.contact_law(contact)
        offset = contact.offset * frames[contact.a.body].scale
        for feature in features:
            one, other = feature.sides
            yield Pair(
                name=f"{name}.{feature.name}",
                kind=feature.kind,
                a=frames[sides[one].body].index,
                b=frames[sides[other].body].index,
                geometry_a=feature.rows[0],
                geometry_b=feature.rows[1],
                clearance=-feature.skin - offset,
                law=law,
                pieces=feature.pieces,
            )


@cached
def _features(mechanism: Mechanism, frames: dict[str, BodyFrame]) -> dict[str, list[_Feature]]:
    """Return, by contact, what can touch of its two sides."""
    return {
        name: [
            *(f for way in WAYS for f in _on_solid(way, {"a": contact.a, "b": contact.b}, frames)),
            *_of_lines(contact.a, contact.b, frames),
        ]
        for name, contact in mechanism.contacts.items()
        if contact.kind in SEVERAL and contact.kind != OUTLINES
    }


def _on_solid(way: tuple[str, str], sides: dict[str, Side], frames: dict[str, BodyFrame]) -> Iterator[_Feature]:
    """Yield the ends of a capsule and the rims of a cylinder against the other side."""
    one, other = (sides[key] for key in way)
    frame, shape, first = frames[one.body], one.primitive, way[0]
    if one.kind not in ("capsule", "cylinder") or shape.half_length is None:
        return
    ends, solid = (-1.0, 1.0), row_b(other, frames[other.body])
    pieces = profile_pieces(other, frames[other.body].scale)
    middle, axis, half = frame.point(shape.point), frame.direction(shape.axis), frame.scale * shape.half_length
    radius = frame.scale * shape.radius
    for i, end in enumerate(ends):
        centre = middle + end * half * axis
        if one.kind == "capsule":
            row, skin, what, kind = geometry_row(centre), radius, f"end_{first}{i}", KINDS[f"sphere-{other.kind}"]
        else:
            row, skin, what = geometry_row(centre, end * axis, tangent(axis), radius, math.pi), 0.0, f"rim_{first}{i}"
            kind = KINDS[f"arc-{other.kind}"]
            if other.kind == "cylinder":
                row[11] = SHALLOW * radius
        yield _Feature(what, kind, way, (row, solid), skin, pieces)


def _of_lines(a: Side, b: Side, frames: dict[str, BodyFrame]) -> Iterator[_Feature]:
    """Yield what two round solids have besides their ends and rims, see `kernels.contact_geometry.rounds`."""
    if {a.kind, b.kind} - {"capsule", "cylinder"}:
        return
    rows = [_line(side, frames[side.body]) for side in (a, b)]
    both = float(rows[0][9] + rows[1][9])
    names = ["crossing", "line0", "line1", *(f"face{i}" for i in range(LAST - LOWER - 2))]
    several = a.kind == b.kind == "cylinder"
    for feature in range(CROSSING, LAST if several else LOWER):
        row = rows[0].copy()
        row[11:] = 2.0 * both, feature
        yield _Feature(names[feature], ROUNDS, ("a", "b"), (row, rows[1]), both, NO_PIECES)


def _line(side: Side, frame: BodyFrame) -> Array:
    """Return the row of the axis of a capsule or cylinder."""
    shape, axis = side.primitive, frame.direction(side.primitive.axis)
    half = math.inf if shape.half_length is None else frame.scale * shape.half_length
    return geometry_row(frame.point(shape.point), axis, tangent(axis), frame.scale * shape.radius, half)
