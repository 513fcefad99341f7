"""Contact primitives as polylines in the frame of their body."""

from typing import Any

import numpy as np

from engine.arrays import Array
from engine.mechanism.surfaces.patches import basis

CORNERS = 49  # points of a full circle
EDGE_POINTS = 9  # points of an edge of a patch
MOST_LINES = 120  # between the patches of a surface
ALONG = 1e-6  # sine of the angle between an axis and the line of sight; below it, any direction across the axis will do


def primitive_polylines(kind: str, primitive: Any, facing: Array) -> list[Array]:
    """Return the polylines, each (k, 3) in the body's frame, of a primitive; none for a point or an unbounded plane.

    ``kind`` is its key in the file, such as "arc". Spheres and rings are drawn as circles perpendicular to ``facing``,
    (3,), the direction to the viewer.
    """
    if kind in ("point", "plane"):
        return []
    if kind == "arc":
        return [circle(primitive.centre, primitive.normal, primitive.radius, primitive.middle, primitive.half_angle)]
    if kind == "disc":
        return [circle(primitive.centre, primitive.normal, primitive.radius)]
    if kind == "rectangle":
        along, (a, b) = np.array(primitive.along), primitive.half_lengths
        return [square(primitive.centre, a * along, b * np.cross(primitive.normal, along))]
    if kind in ("cylinder", "bore"):
        half = (getattr(primitive, "half_length", None) or primitive.radius) * np.array(primitive.axis)
        ends = [np.array(primitive.point) + side * half for side in (-1, 1)]
        return [np.array(ends), *(circle(end, primitive.axis, primitive.radius) for end in ends)]
    if kind == "turned":
        return _turned(primitive, facing)
    if kind == "extruded":
        return _extruded(primitive)
    if kind == "surface":
        return _surface(primitive)
    return [circle(primitive.centre, facing, primitive.radius)]  # sphere, socket, ring


def _turned(primitive: Any, facing: Array) -> list[Array]:
    """Return the two halves of the section that faces the viewer, and a circle at each corner of the profile."""
    axis, place = np.array(primitive.axis), np.array(primitive.point)
    beside = np.cross(axis, facing)
    aside = _across(axis, beside if np.linalg.norm(beside) > ALONG else np.eye(3)[np.argmin(np.abs(axis))])
    lines = [_points(piece) for piece in primitive.curve]
    halves = [place + side * p.real[:, None] * aside + p.imag[:, None] * axis for side in (-1, 1) for p in lines]
    corners = {corner for piece in primitive.curve for corner in (piece.start, piece.end) if corner.real > 0}
    return [*halves, *(circle(place + corner.imag * axis, axis, corner.real) for corner in sorted(corners, key=abs))]


def _extruded(primitive: Any) -> list[Array]:
    """Return the profile at both ends and the edges between its corners; without ends, the profile once."""
    axis, along = np.array(primitive.axis), np.array(primitive.along)
    across, half = np.cross(axis, along), primitive.half_length or 0.0
    levels = [np.array(primitive.point) + side * half * axis for side in ((-1, 1) if half else (0,))]
    outline = np.concatenate([_points(piece) for piece in primitive.curve])
    flat = outline.real[:, None] * along + outline.imag[:, None] * across
    starts = [piece.start.real * along + piece.start.imag * across for piece in primitive.curve]
    return [*(level + flat for level in levels), *(levels + start for start in starts if half)]


def _surface(primitive: Any) -> list[Array]:
    """Return the open edges of a surface and lines between its patches; of many lines, only every second, third, ..."""
    border, between = primitive.outline
    edges = np.concatenate([border, between[:: 1 + len(between) // MOST_LINES]])
    return list(np.einsum("ai,nij->naj", basis(np.linspace(0, 1, EDGE_POINTS))[0], edges))


def _points(piece: Any) -> Array:
    """Return points along a line or an arc of a profile, as complex numbers."""
    return np.asarray(piece.point(np.linspace(0, 1, 2 + int(CORNERS * piece.sweep / (2 * np.pi)))))


def circle(centre: Any, normal: Any, radius: float, middle: Any = None, half_angle: float = np.pi) -> Array:
    """Return an arc about the direction ``middle`` from the centre, or a full circle, as a polyline of shape (49, 3).

    ``half_angle`` is half the angle of the arc [rad].
    """
    n = np.asarray(normal, float)
    e = _across(n, np.eye(3)[np.argmin(np.abs(n))] if middle is None else np.asarray(middle, float))
    angle = np.linspace(-half_angle, half_angle, CORNERS)[:, None]
    return np.asarray(np.asarray(centre) + radius * (np.cos(angle) * e + np.sin(angle) * np.cross(n, e)))


def _across(n: Array, direction: Array) -> Array:
    """Return the unit vector perpendicular to n that is nearest to a direction."""
    e = direction - (direction @ n) * n
    return np.asarray(e / np.linalg.norm(e))


def square(centre: Any, a: Array, b: Array) -> Array:
    """Return the closed parallelogram with half sides a and b, shape (5, 3)."""
    return np.asarray(np.asarray(centre) + np.array([a + b, b - a, -a - b, a - b, a + b]))


def patch(normal: Array, touched: Array, facing: Array, least: float) -> Array:
    """Return a square on a plane that covers its contact points, with sides along and across the line of sight, (5, 3).

    NaN in the points, ``touched`` (m, 3), is ignored; half a side is at least ``least`` [length].
    """
    middle = 0.5 * (np.nanmin(touched, axis=0) + np.nanmax(touched, axis=0))
    along = np.cross(facing, normal)
    along = along / np.linalg.norm(along)
    half = least + np.nanmax(np.abs((touched - middle) @ along))
    return square(middle, half * along, half * np.cross(normal, along))
