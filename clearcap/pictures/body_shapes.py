"""The drawn shape of a body: its primitives and joints from the file, and an outline around them."""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from clearcap.pictures.polylines import circle, patch, primitive_polylines
from clearcap.pictures.view import View, start_rotation
from engine import Mechanism
from engine.arrays import Array
from engine.mechanism.base import BodyPoint

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
    """Return the shape of a body as it is drawn on a view of a mechanism of some `size` [length].

    `touched` has the points of each contact during the run, (m, 3), in the frame of this body; NaN is ignored.
    """
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
    lines += _pins(mechanism, body, facing)
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
    """Yield the sides of contacts on a body, with the name of the contact."""
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
