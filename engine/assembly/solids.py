"""Contacts of two solids that touch at several points at once: each a contact of one feature, named CONTACT.end_a0, ...

Two convex solids are nearest to each other at an end or a rim of one of them, or where two lines cross. So a capsule
lies with its two ends on a plane, and two parallel rollers touch at both ends of what they have in common.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from engine.arrays import Array
from engine.assembly.contacts import KINDS, NO_PIECES, Pair, geometry_row, profile_pieces, row_b
from engine.assembly.frames import BodyFrame, tangent
from engine.assembly.grain import grain_of
from engine.assembly.hulls import ball_around, hulls_of, skin_of
from engine.assembly.table_cache import cached
from engine.kernels.contact_geometry.boxes import CORNERS
from engine.kernels.contact_geometry.rounds import CROSSING, EDGE, LAST, LOWER
from engine.kernels.model import BOXES, HULLS, ROUNDS
from engine.mechanism.contacts import OUTLINES, SEVERAL, Side
from engine.mechanism.meshes.polyhedra import Polyhedron
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
    hulls: tuple[Polyhedron, Polyhedron] | None = None


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
                sticking=mechanism.static_friction(contact),
                grain=grain_of(mechanism, contact, frames),
                table=f"contacts.{name}",
                pieces=feature.pieces,
                hulls=feature.hulls,
            )


@cached
def _features(mechanism: Mechanism, frames: dict[str, BodyFrame]) -> dict[str, list[_Feature]]:
    """Return, by contact, what can touch of its two sides."""
    return {
        name: [*_of_hulls(*contact.sides, contact.a, frames)]
        if "mesh" in (contact.a.kind, contact.b.kind)
        else [
            *(f for way in WAYS for f in _on_solid(way, {"a": contact.a, "b": contact.b}, frames)),
            *_of_lines(contact.a, contact.b, frames),
            *_of_boxes(contact.a, contact.b, frames),
        ]
        for name, contact in mechanism.contacts.items()
        if contact.kind in SEVERAL and contact.kind != OUTLINES
    }


def _on_solid(way: tuple[str, str], sides: dict[str, Side], frames: dict[str, BodyFrame]) -> Iterator[_Feature]:
    """Yield the ends of a capsule, the rims of a cylinder, and corners and edges of a box against the other side."""
    one, other = (sides[key] for key in way)
    frame, shape, first = frames[one.body], one.primitive, way[0]
    if one.kind == "box" and other.kind != "box":
        yield from _of_box(way, one, other, frames)
    if one.kind not in ("capsule", "cylinder") or shape.half_length is None:
        return
    ends, solid = (-1.0, 1.0), row_b(other, frames[other.body])
    pieces = profile_pieces(other, frames[other.body].scale)
    middle, axis, half = frame.point(shape.point), frame.direction(shape.axis), frame.scale * shape.half_length
    radius = frame.scale * shape.radius
    for i, end in enumerate(ends):
        centre = middle + end * half * axis
        if one.kind == "capsule":
            kind, row = KINDS[f"sphere-{other.kind}"], geometry_row(centre)
            yield _Feature(f"end_{first}{i}", kind, way, (row, solid), radius, pieces)
            continue
        parts = 3 if other.kind == "box" else 1  # a face of a box holds an end at three points
        for part in range(parts):
            turn = 2.0 * math.pi * part / parts
            middle_of_arc = math.cos(turn) * tangent(axis) + math.sin(turn) * np.cross(axis, tangent(axis))
            row = geometry_row(centre, end * axis, middle_of_arc, radius, math.pi / parts)
            row[11] = 0.0 if other.kind == "capsule" else SHALLOW * radius
            name, kind = f"rim_{first}{parts * i + part}", KINDS[f"arc-{other.kind}"]
            yield _Feature(name, kind, way, (row, solid), 0.0, pieces)


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
        yield _Feature(names[feature - CROSSING], ROUNDS, ("a", "b"), (row, rows[1]), both, NO_PIECES)


def _of_box(way: tuple[str, str], one: Side, other: Side, frames: dict[str, BodyFrame]) -> Iterator[_Feature]:
    """Yield the corners of a box against the other side, and its edges against the line of a capsule or cylinder."""
    frame, first, solid = frames[one.body], way[0], row_b(other, frames[other.body])
    pieces, box = profile_pieces(other, frames[other.body].scale), row_b(one, frame)
    place, axes = box[:3], np.array([box[6:9], np.cross(box[3:6], box[6:9]), box[3:6]])
    arms = axes * box[[9, 10, 12], None]
    for i, corner in enumerate(product((-1.0, 1.0), repeat=3)):
        row = geometry_row(place + np.array(corner) @ arms)
        yield _Feature(f"corner_{first}{i}", KINDS[f"point-{other.kind}"], way, (row, solid), 0.0, pieces)
    if other.kind not in ("capsule", "cylinder"):
        return
    line = _line(other, frames[other.body])
    radius, line[11] = float(line[9]), line[10] if other.kind == "cylinder" else math.inf
    for i, (k, *signs) in enumerate(product(range(3), (-1.0, 1.0), (-1.0, 1.0))):
        j, m = (k + 1) % 3, (k + 2) % 3
        out = math.sqrt(0.5) * (signs[0] * axes[j] + signs[1] * axes[m])
        row = geometry_row(place + signs[0] * arms[j] + signs[1] * arms[m], axes[k], out, 0.0, box[[9, 10, 12]][k])
        row[11:] = 2.0 * radius, EDGE
        yield _Feature(f"edge_{first}{i}", ROUNDS, way, (row, line), radius, NO_PIECES)


def _of_boxes(a: Side, b: Side, frames: dict[str, BodyFrame]) -> Iterator[_Feature]:
    """Yield the nearest points of two boxes, and the corners of what their faces have in common."""
    if not a.kind == b.kind == "box":
        return
    rows = []
    for side in (a, b):
        row = row_b(side, frames[side.body])
        row[11:] = row[12], 0.0
        rows.append(row)
    for feature in range(CORNERS + 1):
        row = rows[0].copy()
        row[12] = feature
        yield _Feature(f"corner{feature}" if feature else "nearest", BOXES, ("a", "b"), (row, rows[1]), 0.0, NO_PIECES)


def _of_hulls(one: Side, other: Side, a: Side, frames: dict[str, BodyFrame]) -> Iterator[_Feature]:
    """Yield the nearest points of each two convex pieces, and the corners of what their faces have in common."""
    way = WAYS[0] if one is a else WAYS[1]
    skin = skin_of(one, frames[one.body])
    own, others = (hulls_of(side, frames[side.body]) for side in (one, other))
    last = 0 if one.kind in ("point", "sphere") else CORNERS
    for (i, hull), (j, partner) in product(enumerate(own), enumerate(others)):
        middle, radius = ball_around(hull)
        of = ".".join(f"piece_{key}{k}" for key, k, n in zip(way, (i, j), (own, others), strict=True) if len(n) > 1)
        for feature in range(last + 1):
            row = geometry_row(middle, np.zeros(6), radius, 0.0, radius + ball_around(partner)[1] + skin, feature)
            name = f"{of}.corner{feature}" if feature else f"{of}.nearest"
            sides = row, geometry_row(ball_around(partner)[0])
            yield _Feature(name.lstrip("."), HULLS, way, sides, skin, NO_PIECES, (hull, partner))


def _line(side: Side, frame: BodyFrame) -> Array:
    """Return the row of the axis of a capsule or cylinder."""
    shape, axis = side.primitive, frame.direction(side.primitive.axis)
    half = math.inf if shape.half_length is None else frame.scale * shape.half_length
    return geometry_row(frame.point(shape.point), axis, tangent(axis), frame.scale * shape.radius, half)
