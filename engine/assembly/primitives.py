"""Contact primitives as geometry rows (table in `kernels.contact_geometry.gaps`), from the centre of mass."""

import math
from typing import Any

import numpy as np

from engine.arrays import Array
from engine.assembly.frames import BodyFrame, tangent
from engine.kernels.model import GEOMETRY
from engine.mechanism.contacts import Contact, Side
from engine.mechanism.surfaces.bezier import mean_direction

ENDLESS = math.inf


def rows(contact: Contact, frame_a: BodyFrame, frame_b: BodyFrame) -> tuple[Array, Array, float]:
    """Return the rows of a contact's two sides, shape (GEOMETRY,) each, and the length added to their distance.

    This length is minus the contact's offset and minus the skin of side a, i.e. the radius of a sphere or of a rounded
    edge; for a ring around a cylinder it is the radial clearance between them.
    """
    a, b = contact.sides
    row, skin = _row_a(a, frame_a)
    if contact.kind == "ring-cylinder":
        pin = b.primitive
        n = frame_b.direction(pin.axis)
        return row, _row(frame_b.point(pin.point), n, tangent(n), pin.radius), skin - pin.radius - contact.offset
    return row, row_b(b, frame_b), -skin - contact.offset


def _row_a(side: Side, frame: BodyFrame) -> tuple[Array, float]:
    """Return the row of side a, and its skin."""
    shape = side.primitive
    if side.kind == "point":
        return _row(frame.point(shape)), 0.0
    if side.kind in ("sphere", "ring"):
        return _row(frame.point(shape.centre)), shape.radius
    if side.kind == "arc":
        n = frame.direction(shape.normal)
        e = tangent(n) if shape.middle is None else _across(n, frame.direction(shape.middle))
        return _row(frame.point(shape.centre), n, e, shape.radius, shape.half_angle), shape.edge_radius
    n = frame.direction(shape.axis)  # a cylinder, represented by its circle at mid-height
    return _row(frame.point(shape.point), n, tangent(n), shape.radius, math.pi), 0.0


def row_b(side: Side, frame: BodyFrame) -> Array:
    """Return the row of side b: place, axis, tangent and bounds."""
    shape = side.primitive
    if side.kind == "surface":
        middle, pole = mean_direction(shape.top)
        n = frame.direction(pole)
        return _row(frame.point(middle), n, tangent(n))
    if side.kind in ("sphere", "socket"):
        pole = np.array([0.0, 0.0, 1.0])
        bounds = _walls(shape.radius, side.kind == "socket")
        return _row(frame.point(shape.centre), pole, tangent(pole), *bounds, -ENDLESS, ENDLESS)
    if side.kind in ("cylinder", "bore"):
        n, half = frame.direction(shape.axis), ENDLESS if shape.half_length is None else shape.half_length
        return _row(frame.point(shape.point), n, tangent(n), *_walls(shape.radius, side.kind == "bore"), -half, half)
    if side.kind == "turned":
        n = frame.direction(shape.axis)
        return _row(frame.point(shape.point), n, tangent(n))
    if side.kind == "extruded":
        n, half = frame.direction(shape.axis), ENDLESS if shape.half_length is None else shape.half_length
        return _row(frame.point(shape.point), n, _across(n, frame.direction(shape.along)), half)
    n = frame.direction(shape.normal)
    if side.kind == "plane":
        return _row(frame.point(shape.point), n, tangent(n))
    if side.kind == "disc":
        depth = shape.radius if shape.depth is None else shape.depth
        return _row(frame.point(shape.centre), n, tangent(n), -ENDLESS, shape.radius, -depth, 0.0)
    depth = min(shape.half_lengths) if shape.depth is None else shape.depth
    e = _across(n, frame.direction(shape.along))
    return _row(frame.point(shape.centre), n, e, *shape.half_lengths, -depth, 0.0)


def _row(*numbers: Any) -> Array:
    """Return numbers and vectors as a row, padded with zeros."""
    row, at = np.zeros(GEOMETRY), 0
    for part in numbers:
        size = 1 if isinstance(part, float | int) else len(part)
        row[at : at + size] = part
        at += size
    return row


def _walls(radius: float, hollow: bool) -> tuple[float, float]:
    """Return the smallest and largest distance of a round solid's material from its axis."""
    return (radius, ENDLESS) if hollow else (-ENDLESS, radius)


def _across(n: Array, direction: Array) -> Array:
    """Return the unit vector perpendicular to n that is nearest to a direction."""
    e = direction - (direction @ n) * n
    return np.asarray(e / np.linalg.norm(e))
