"""Plane faces of two parts that face each other across a small gap: candidates for stops.

What two plane faces share, as seen along the normal, is the area that their triangles share.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from engine.arrays import Array, Integers
from engine.cad.cad_model import CadAssembly, CadFace, Coordinates, Millimetres, SquareMillimetres
from engine.cad.geometry import perpendicular

REACH = 1.0
"""Largest gap between faces that could form a stop [mm]."""
DEEPEST_OVERLAP = 0.1
"""Largest overlap of such faces as posed [mm]."""
LEAST_AREA = 0.25
"""Smallest area shared by two plane faces [mm2]: anything less is a sliver, where one edge lies over another."""
_PARALLEL = 1e-3  # rad
_LEAST_SHARE = 1e-3  # of the smaller face; less is a corner over an edge


@dataclass(frozen=True, eq=False, kw_only=True)
class FacingPlanes:
    """Two plane faces that overlap at least partly, as seen along their normal."""

    faces: tuple[int, int]
    parts: tuple[str, str]
    gap: Millimetres
    """Distance as posed [mm]; negative where the parts overlap."""
    area: SquareMillimetres
    """Shared area [mm2], with round edges replaced by chords."""
    middle: Coordinates
    """Middle of the shared area, on the first face, shape (3,) [mm]."""
    normal: Array
    """Normal of the first face, towards the second, shape (3,)."""


def facing_planes(assembly: CadAssembly, triangles: dict[int, Array]) -> list[FacingPlanes]:
    """Return the plane faces of different parts that face each other, the smallest gap first.

    The gap is at most 1 mm, and the shared area is at least 0.25 mm2.
    """
    planes = [face for face in assembly.faces if face.kind == "plane" and face.number in triangles]
    found = []
    for i, j in _near(planes, triangles).tolist():
        first, second = planes[i], planes[j]
        area, middle = common_area(triangles[first.number], triangles[second.number], first.axis)
        if area > max(LEAST_AREA, _LEAST_SHARE * min(first.area, second.area)):
            found.append(
                FacingPlanes(
                    faces=(first.number, second.number),
                    parts=(first.part, second.part),
                    gap=float((second.point - first.point) @ first.axis),
                    area=area,
                    middle=middle,
                    normal=first.axis,
                )
            )
    return sorted(found, key=lambda pair: pair.gap)


def _near(planes: list[CadFace], triangles: dict[int, Array]) -> Integers:
    """Return the pairs of planes that may face each other: opposite normals, a small gap, close boxes; (n, 2)."""
    if len(planes) < 2:
        return np.zeros((0, 2), np.int64)
    normals, points = np.array([f.axis for f in planes]), np.array([f.point for f in planes])
    parts = np.unique([f.part for f in planes], return_inverse=True)[1]
    # `<` of the parts: each pair once, and none within a part
    opposite = np.argwhere((normals @ normals.T < -np.cos(_PARALLEL)) & (parts[:, None] < parts))
    gaps = np.einsum("nk,nk->n", points[opposite[:, 1]] - points[opposite[:, 0]], normals[opposite[:, 0]])
    opposite = opposite[(gaps <= REACH) & (gaps >= -DEEPEST_OVERLAP)]
    corners = [triangles[f.number].reshape(-1, 3) for f in planes]
    lows = np.array([each.min(axis=0) for each in corners]) - REACH
    highs = np.array([each.max(axis=0) for each in corners]) + REACH
    i, j = opposite.T
    near: Integers = opposite[((lows[i] <= highs[j]) & (lows[j] <= highs[i])).all(axis=1)]
    return near


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
