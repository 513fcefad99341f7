"""The overlap of two plane faces: the area that their triangles share, as seen along the normal."""

import numpy as np
from numpy.typing import NDArray

from engine.arrays import Array
from engine.cad.angles import perpendicular
from engine.cad.cad_model import CadAssembly


def triangles_by_face(assembly: CadAssembly) -> dict[int, Array]:
    """Return the corners of each face's triangles, shape (n, 3, 3) [mm], by face number."""
    found = {}
    for mesh in assembly.meshes:
        corners = mesh.vertices[mesh.triangles]
        for number in np.unique(mesh.faces).tolist():
            found[number] = corners[mesh.faces == number]
    return found


def common_area(first: Array, second: Array, normal: Array) -> tuple[float, Array]:
    """Return the area [mm2] that two faces share, as seen along a unit vector, and its centroid [mm], shape (3,).

    The faces are given by the corners of their triangles, shape (n, 3, 3) [mm]. The centroid lies on the first face;
    area and centroid are zero if nothing is shared.
    """
    frame = perpendicular(normal)
    one, other = (_counter_clockwise(corners @ frame.T) for corners in (first, second))
    lows, highs = other.min(axis=1), other.max(axis=1)
    total, moment = 0.0, np.zeros(2)
    for triangle in one:
        close = ((lows < triangle.max(axis=0)) & (highs > triangle.min(axis=0))).all(axis=1)
        for partner in other[close]:
            area, centroid = _area(_clipped(partner, triangle))
            total += area
            moment += area * centroid
    if total <= 0:
        return 0.0, np.zeros(3)
    height = float(first.reshape(-1, 3)[0] @ normal)
    middle: Array = moment / total @ frame + height * normal
    return total, middle


def contains(triangles: Array, points: Array, normal: Array) -> NDArray[np.bool_]:
    """Return which points, shape (m, 3), lie in a plane face as seen along its unit normal; corners (n, 3, 3)."""
    frame = perpendicular(normal)
    corners, flat = _counter_clockwise(triangles @ frame.T), points @ frame.T
    sides = np.roll(corners, -1, axis=1) - corners
    away = flat[:, None, None] - corners
    left = sides[..., 0] * away[..., 1] - sides[..., 1] * away[..., 0]
    inside: NDArray[np.bool_] = np.any(np.all(left >= -1e-12, axis=2), axis=1)
    return inside


def _counter_clockwise(triangles: Array) -> Array:
    """Return triangles of a plane, shape (n, 3, 2), all oriented counter-clockwise."""
    sides = triangles[:, 1:] - triangles[:, :1]
    turned = sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0] < 0
    return np.where(turned[:, None, None], triangles[:, ::-1], triangles)


def _clipped(polygon: Array, window: Array) -> Array:
    """Return the part of a convex polygon inside a convex window (Sutherland and Hodgman 1974), shape (n, 2)."""
    for start, end in zip(window, np.roll(window, -1, axis=0), strict=True):
        if not len(polygon):
            break
        side = end - start
        left = side[0] * (polygon[:, 1] - start[1]) - side[1] * (polygon[:, 0] - start[0])
        kept = []
        for i in range(len(polygon)):
            j = (i + 1) % len(polygon)
            if left[i] >= 0:
                kept.append(polygon[i])
            if (left[i] > 0) != (left[j] > 0) and left[i] != left[j]:
                kept.append(polygon[i] + left[i] / (left[i] - left[j]) * (polygon[j] - polygon[i]))
        polygon = np.array(kept).reshape(-1, 2)
    return polygon


def _area(polygon: Array) -> tuple[float, Array]:
    """Return the area and centroid of a convex polygon, shape (n, 2)."""
    if len(polygon) < 3:
        return 0.0, np.zeros(2)
    away = polygon[1:] - polygon[0]
    doubled = away[:-1, 0] * away[1:, 1] - away[:-1, 1] * away[1:, 0]
    area = float(doubled.sum()) / 2
    if area <= 0:
        return 0.0, np.zeros(2)
    return area, polygon[0] + doubled @ (away[:-1] + away[1:]) / (6 * area)
