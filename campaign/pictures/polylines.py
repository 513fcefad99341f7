"""Contact primitives as polylines in the frame of their body."""

from typing import Any

import numpy as np

from engine.arrays import Array

CORNERS = 49  # of a full circle


def primitive_polylines(kind: str, primitive: Any, facing: Array) -> list[Array]:
    """Return the polylines of a primitive of a contact; none for a point or an unbounded plane.

    Parameters
    ----------
    kind : str
        Its key in the file, such as "arc".
    primitive : object
        As the file describes it.
    facing : ndarray, shape (3,)
        Direction to the viewer: spheres and rings are drawn as circles across it.

    Returns
    -------
    list of ndarray, each of shape (k, 3)
        In the frame of the body.
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
    return [circle(primitive.centre, facing, primitive.radius)]  # sphere, socket, ring


def circle(centre: Any, normal: Any, radius: float, middle: Any = None, half_angle: float = np.pi) -> Array:
    """Return an arc about ``middle``, or a full circle.

    Parameters
    ----------
    centre, normal : array_like, shape (3,)
        Of the circle.
    radius : float
        Of the circle [length].
    middle : array_like, shape (3,), optional
        Direction from the centre to the middle of the arc.
    half_angle : float
        Half the angle of the arc [rad].

    Returns
    -------
    ndarray, shape (49, 3)
        Points of the polyline.
    """
    n = np.asarray(normal, float)
    e = np.eye(3)[np.argmin(np.abs(n))] if middle is None else np.asarray(middle, float)
    e = e - (e @ n) * n
    e = e / np.linalg.norm(e)
    angle = np.linspace(-half_angle, half_angle, CORNERS)[:, None]
    return np.asarray(np.asarray(centre) + radius * (np.cos(angle) * e + np.sin(angle) * np.cross(n, e)))


def square(centre: Any, a: Array, b: Array) -> Array:
    """Return the closed parallelogram with half sides a and b, shape (5, 3)."""
    return np.asarray(np.asarray(centre) + np.array([a + b, b - a, -a - b, a - b, a + b]))


def patch(normal: Array, touched: Array, facing: Array, least: float) -> Array:
    """Return a square of a plane that covers where it is touched, its sides along and across the line of sight.

    Parameters
    ----------
    normal : ndarray, shape (3,)
        Of the plane.
    touched : ndarray, shape (m, 3)
        Points of the plane; NaN does not count.
    facing : ndarray, shape (3,)
        Direction to the viewer.
    least : float
        Smallest half of a side [length].

    Returns
    -------
    ndarray, shape (5, 3)
        The closed polyline.
    """
    middle = 0.5 * (np.nanmin(touched, axis=0) + np.nanmax(touched, axis=0))
    along = np.cross(facing, normal)
    along = along / np.linalg.norm(along)
    half = least + np.nanmax(np.abs((touched - middle) @ along))
    return square(middle, half * along, half * np.cross(normal, along))
