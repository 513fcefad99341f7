"""The drawn shape of a body: its primitives and joints from the file, and an outline around them."""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from clearcap.pictures.view import View, start_rotation
from engine import Mechanism
from engine.arrays import Array
from engine.mechanism.base import BodyPoint
from engine.mechanism.couplings import GearPair
from engine.mechanism.surfaces.patches import basis

DRAWN_WITH_OUTLINE = ("arc", "rectangle")  # of a body with an outline: a whole cylinder would hide the body
FACE_ON = 0.95  # cosine between a plane's normal and the line of sight; planes with a larger one are not drawn
LEAST_PATCH = 0.05  # half a side of a plane's patch with a single contact point, in sizes of the mechanism


@dataclass(frozen=True)
class BodyShape:
    """The shape of a body in its own frame; all points have shape (k, 3)."""

    lines: tuple[Array, ...]  # polylines of primitives and pins
    faces: tuple[Array, ...]  # patches of planes with contacts, each of shape (5, 3)
    joints: Array  # positions of its joints
    # From the file, or the corners of a hull around everything except the planes: a polygon, line, point, or none.
    outline: Array


def body_shape(mechanism: Mechanism, body: str, view: View, touched: dict[str, Array], size: float) -> BodyShape:
    """Return the shape of a body on a view; `touched` has the points of contacts in its frame, (m, 3), or NaN."""
    turn = start_rotation(mechanism, body)
    facing = turn.T @ view.normal
    lines, planes = [], defaultdict(list)
    outlined = mechanism.bodies[body].outline is not None
    for name, side in _sides(mechanism, body):
        primitive = getattr(side, side.kind)
        if not outlined or side.kind in DRAWN_WITH_OUTLINE:
            lines += primitive_polylines(side.kind, primitive, facing)
        if side.kind == "plane" and abs(np.dot(primitive.normal, facing)) < FACE_ON:
            planes[primitive.point, primitive.normal].append(touched[name])  # contacts on one plane share a patch
    lines += _pins(mechanism, body, facing) + _gears(mechanism, body)
    joints = [side.point for joint in mechanism.joints.values() for side in joint.sides if side.body == body]
    return BodyShape(
        lines=tuple(lines),
        faces=tuple(patch(np.array(n), np.vstack(t), facing, LEAST_PATCH * size) for (_, n), t in planes.items()),
        joints=np.reshape(joints, (-1, 3)),
        outline=_outline(mechanism, body, lines, view),
    )


def _outline(mechanism: Mechanism, body: str, lines: list[Array], view: View) -> Array:
    """Return the outline of a body from the file, else the hull around its lines and its points in the file."""
    outline = mechanism.bodies[body].outline
    if outline is not None:
        return np.array(outline)
    corners = np.vstack([np.reshape(list(_points(mechanism, body)), (-1, 3)), *lines])
    return np.asarray(corners[hull(view.project(corners @ start_rotation(mechanism, body).T))])


def hull(points: Array) -> list[int]:
    """Return the indices of the corners of the convex hull of points (k, 2), in order; for a line, its two ends."""
    if len(points) < 2:
        return list(range(len(points)))
    try:
        return [int(i) for i in ConvexHull(points).vertices]
    except QhullError:  # all on one line
        direction = np.linalg.svd(points - points.mean(axis=0))[2][0]
        along = points @ direction
        return [int(np.argmin(along)), int(np.argmax(along))]


def linear_loads(mechanism: Mechanism) -> list[tuple[BodyPoint, BodyPoint]]:
    """Return the two ends of each linear spring and damper."""
    loads = (*mechanism.springs.values(), *mechanism.dampers.values())
    return [(load.a, load.b) for load in loads if load.type == "linear"]


def _sides(mechanism: Mechanism, body: str) -> Iterator[tuple[str, Any]]:
    for name, contact in mechanism.contacts.items():
        yield from ((name, side) for side in (contact.a, contact.b) if side.body == body)


def _pins(mechanism: Mechanism, body: str, facing: Array) -> list[Array]:
    """Return a circle for each pin, bore, ball and socket of a body; the play is too small to be visible."""
    return [
        circle(side.point, facing if joint.axes is None else joint.axes[i], _radius(joint))
        for joint in mechanism.joints.values()
        for i, side in enumerate(joint.sides)
        if side.body == body and _radius(joint) > 0
    ]


def _gears(mechanism: Mechanism, body: str) -> list[Array]:
    """Return the pitch circle of each gear on a body."""
    pairs = [pair for pair in mechanism.couplings.values() if isinstance(pair, GearPair)]
    found = {(g.place, g.direction, 0.5 * p.module * g.teeth): None for p in pairs for g in p.gears if g.body == body}
    return [circle(*key) for key in found]


def _radius(joint: Any) -> float:
    """Return the radius of a joint's pin, ball or shaft; 0 if it has none."""
    pin = getattr(joint, "ball", None) or getattr(joint, "shaft", None)
    return float(max(getattr(joint, "radii", ()), default=getattr(pin, "radius", None) or 0.0))


def _points(mechanism: Mechanism, body: str) -> Iterator[tuple[float, float, float]]:
    """Yield the points on a body from the file: its centre of mass, joints, contacts, loads and responses."""
    yield mechanism.bodies[body].center_of_mass
    yield from (side.point for _, side in _sides(mechanism, body) if side.kind == "point")
    ends: list[Any] = [side for joint in mechanism.joints.values() for side in joint.sides]
    ends += [end for pair in linear_loads(mechanism) for end in pair]
    ends += mechanism.forces.values()
    ends += [end for r in mechanism.responses.values() for key in ("from_", "to") if (end := getattr(r, key, None))]
    yield from (end.point for end in ends if end.body == body and end.point is not None)


CORNERS = 49  # points of a full circle
EDGE_POINTS = 9  # points of an edge of a patch
MOST_EDGES, LEAST_EDGES = 600, 12  # of all convex pieces of a mesh, and of one
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
    if kind == "box":
        return _box(primitive)
    if kind in ("turned", "capsule"):
        return _turned(primitive, facing)
    if kind == "extruded":
        return _extruded(primitive)
    if kind == "surface":
        return _surface(primitive)
    if kind == "mesh":
        return [line for solid in primitive.polyhedra for line in _edges(solid, len(primitive.polyhedra))]
    return [circle(primitive.centre, facing, primitive.radius)]  # sphere, socket, ring


def _turned(primitive: Any, facing: Array) -> list[Array]:
    """Return the two halves of the section that faces the viewer, and a circle at each corner of the profile."""
    axis, place = np.array(primitive.axis), np.array(primitive.point)
    beside = np.cross(axis, facing)
    aside = _across(axis, beside if np.linalg.norm(beside) > ALONG else np.eye(3)[np.argmin(np.abs(axis))])
    lines = [_curve_points(piece) for piece in primitive.curve]
    halves = [place + side * p.real[:, None] * aside + p.imag[:, None] * axis for side in (-1, 1) for p in lines]
    corners = {corner for piece in primitive.curve for corner in (piece.start, piece.end) if corner.real > 0}
    return [*halves, *(circle(place + corner.imag * axis, axis, corner.real) for corner in sorted(corners, key=abs))]


def _box(primitive: Any) -> list[Array]:
    """Return the two faces across the box's third side, and the edges between them."""
    along, normal = np.array(primitive.along), np.array(primitive.normal)
    axes = np.array([along, np.cross(normal, along), normal]) * np.array(primitive.half_lengths)[:, None]
    bottom, top = (square(primitive.centre + side * axes[2], axes[0], axes[1]) for side in (-1, 1))
    return [bottom, top, *(np.array(ends) for ends in zip(bottom[:4], top[:4], strict=True))]


def _extruded(primitive: Any) -> list[Array]:
    """Return the profile at both ends and the edges between its corners; without ends, the profile once."""
    axis, along = np.array(primitive.axis), np.array(primitive.along)
    across, half = np.cross(axis, along), primitive.half_length or 0.0
    levels = [np.array(primitive.point) + side * half * axis for side in ((-1, 1) if half else (0,))]
    outline = np.concatenate([_curve_points(piece) for piece in primitive.curve])
    flat = outline.real[:, None] * along + outline.imag[:, None] * across
    starts = [piece.start.real * along + piece.start.imag * across for piece in primitive.curve]
    return [*(level + flat for level in levels), *(levels + start for start in starts if half)]


def _surface(primitive: Any) -> list[Array]:
    """Return the open edges of a surface and lines between its patches; of many lines, only every second, third, ..."""
    border, between = primitive.outline
    edges = np.concatenate([border, between[:: 1 + len(between) // MOST_LINES]])
    return list(np.einsum("ai,nij->naj", basis(np.linspace(0, 1, EDGE_POINTS))[0], edges))


def _edges(solid: Any, pieces: int) -> list[Array]:
    """Return the edges of one of several convex pieces, the sharpest; its share of the lines that are drawn at most."""
    n = solid.faces[:, :3]
    cosine = np.einsum("ij,ij->i", n[solid.edges[:, 2]], n[solid.edges[:, 3]])
    sharpest = np.argsort(cosine, kind="stable")[: max(MOST_EDGES // pieces, LEAST_EDGES)]
    return [solid.corners[edge[:2]] for edge in solid.edges[np.sort(sharpest)]]


def _curve_points(piece: Any) -> Array:
    """Return points along a line or an arc of a profile, as complex numbers."""
    return np.asarray(piece.point(np.linspace(0, 1, 2 + int(CORNERS * piece.sweep / (2 * np.pi)))))


def circle(centre: Any, normal: Any, radius: float, middle: Any = None, half_angle: float = np.pi) -> Array:
    """Return an arc of half an angle [rad] about the direction ``middle``, or a full circle, as a polyline (49, 3)."""
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
