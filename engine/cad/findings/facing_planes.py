"""Plane faces of two parts that face each other: candidates for stops, and ends and flanges of a joint.

What two plane faces share, as seen along the normal, is the area that their triangles share. Faces across a joint's
axis limit the sliding of its pin: ends of the bearing, flanges of the journal.
"""

from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from engine.arrays import Array, Integers
from engine.cad.cad_model import CadAssembly, CadFace, Coordinates, Millimetres, SquareMillimetres
from engine.cad.findings.joints import MOST_EXCESS, PinInHole
from engine.cad.geometry import perpendicular

REACH = 1.0  # largest gap between faces that could form a stop [mm]
DEEPEST_OVERLAP = 0.1  # largest overlap of such faces as posed [mm]
LEAST_AREA = 0.25
"""Smallest area shared by two plane faces [mm2]: anything less is a sliver, where one edge lies over another."""
_SHARE_OF_PART, _SIZES_APART = 0.005, 0.5
"""Of very small parts: share of a part's surface in place of the area, and gap in sides of a cube of that surface."""
_PARALLEL = 1e-3  # rad
_LEAST_SHARE = 1e-3  # of the smaller face; less is a corner over an edge


@dataclass(frozen=True, eq=False, kw_only=True)
class FacingPlanes:
    """Two plane faces that overlap at least partly, as seen along their normal."""

    faces: tuple[int, int]
    parts: tuple[str, str]
    gap: Millimetres  # distance as posed [mm]; negative where the parts overlap
    area: SquareMillimetres  # shared area [mm2], with round edges replaced by chords
    middle: Coordinates  # middle of the shared area, on the first face, shape (3,) [mm]
    normal: Array  # normal of the first face, towards the second, shape (3,)


def facing_planes(assembly: CadAssembly, triangles: dict[int, Array]) -> list[FacingPlanes]:
    """Return the planes of different parts that face each other, at most `REACH` apart, the smallest gap first."""
    surfaces = dict.fromkeys((part.name for part in assembly.parts), 0.0)
    for face in assembly.faces:
        surfaces[face.part] += face.area
    planes = [face for face in assembly.faces if face.kind == "plane" and face.number in triangles]
    found = []
    for i, j in _near(planes, triangles).tolist():
        first, second = planes[i], planes[j]
        gap = float((second.point - first.point) @ first.axis)
        smaller = min(surfaces[first.part], surfaces[second.part])
        if gap > _SIZES_APART * (smaller / 6) ** 0.5:
            continue
        area, middle = common_area(triangles[first.number], triangles[second.number], first.axis)
        least = max(min(LEAST_AREA, _SHARE_OF_PART * smaller), _LEAST_SHARE * min(first.area, second.area))
        if area > least:
            faces, parts = (first.number, second.number), (first.part, second.part)
            found.append(FacingPlanes(faces=faces, parts=parts, gap=gap, area=area, middle=middle, normal=first.axis))
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


# -- ends and flanges of a joint --------------------------------------------------------------------------------------

_MOST_PLAY = 1.0  # largest axial play at one end [mm] at which a face counts as a flange
_DEEPEST_FLANGE = 0.02  # mm by which such a face may overlap the bearing
_ACROSS = 1e-4  # rad between a plane's normal and the axis
_WIDEST = 3.0  # multiple of the hole's radius
_SHRUNK = 0.985  # factor, so that the chords of a mesh do not cut off a circle
_ANGLES, _RADII = 24, 41


@dataclass(frozen=True, eq=False, kw_only=True)
class ThrustFaces:
    """An end face of a bearing and the flange of its journal that can touch it."""

    side: Literal["start", "end"]  # the end of the bearing along the joint's axis
    bearing_face: int
    journal_face: int
    station: Millimetres  # position of the bearing's end face along the joint's axis, measured from its point [mm]
    play: Millimetres  # distance between the two faces as posed [mm]; negative where they overlap
    radius: Millimetres  # radius of the largest circle about the axis that lies in both faces [mm]


def thrust_faces(assembly: CadAssembly, joint: PinInHole, triangles: dict[int, Array]) -> list[ThrustFaces]:
    """Return the nearest end face and flange at each end of a joint; none where the pin is free to slide."""
    found = []
    for way in (-1.0, 1.0):
        outward = way * joint.axis
        ends, flanges = (
            [f for f in assembly.faces_of(part) if f.kind == "plane" and f.axis @ normal > np.cos(_ACROSS)]
            for part, normal in ((joint.bearing, outward), (joint.journal, -outward))
        )
        tried = [_thrust(assembly, joint, both, way, triangles) for both in product(ends, flanges)]
        found += sorted(filter(None, tried), key=lambda pair: pair.play)[:1]
    return found


def _thrust(
    assembly: CadAssembly, joint: PinInHole, faces: tuple[CadFace, CadFace], way: float, triangles: dict[int, Array]
) -> ThrustFaces | None:
    """Return an end face and a flange that can touch; None if they cannot."""
    end, flange = faces
    station = float((end.point - joint.point) @ joint.axis)
    play = float((flange.point - end.point) @ joint.axis) * way
    middle = (joint.seats[0].start + joint.seats[-1].end) / 2
    if (station - middle) * way <= 0 or not -_DEEPEST_FLANGE <= play <= _MOST_PLAY:
        return None
    hole = max(seat.hole_radius for seat in joint.seats)
    angles = np.linspace(0.0, 2 * np.pi, _ANGLES, endpoint=False)
    around = np.column_stack([np.cos(angles), np.sin(angles)]) @ perpendicular(joint.axis)
    for radius, tested in _radii(assembly, joint, faces, hole):
        circle = joint.point + station * joint.axis + tested * around
        if all(contains(triangles[face.number], circle, joint.axis).all() for face in faces):
            return ThrustFaces(
                side="end" if way > 0 else "start",
                bearing_face=end.number,
                journal_face=flange.number,
                station=station,
                play=play,
                radius=radius,
            )
    return None


def _radii(
    assembly: CadAssembly, joint: PinInHole, faces: tuple[CadFace, CadFace], hole: float
) -> list[tuple[float, float]]:
    """Return radii to be tried, the largest first, each with the radius of the points that must lie in both faces."""
    numbers = {face.number for face in faces}
    edges = [e for e in assembly.edges if numbers & set(e.faces) and e.radius > hole]
    away = [edge.centre - joint.point for edge in edges]
    about = [
        edge.radius
        for edge, each in zip(edges, away, strict=True)
        if np.linalg.norm(each - (each @ joint.axis) * joint.axis) <= joint.radial_clearance + MOST_EXCESS
    ]
    between = np.linspace(hole, _WIDEST * hole, _RADII)[1:].tolist()
    return sorted([*((r, _SHRUNK * r) for r in about), *((r, r) for r in between)], reverse=True)
