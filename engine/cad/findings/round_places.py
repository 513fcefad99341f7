"""The place where a round face, i.e. a convex cylinder or a ball, is nearest to a face of another kind."""

from collections.abc import Callable
from dataclasses import dataclass
from math import radians, tau

import numpy as np

from engine.arrays import Array
from engine.cad.angles import perpendicular
from engine.cad.cad_model import CadFace
from engine.cad.findings.common_area import contains
from engine.cad.triangle_distance import distance_to_triangles, nearest_on_triangles

LEAST_LENGTH = 0.2
"""Shortest line of possible contact of a cylinder [mm]: anything shorter is a corner of one face over another."""
WHOLE = tau - 0.01
"""Smallest span of a cylinder [rad] that counts as a full turn."""
_PARALLEL = 1e-3  # rad
_CLOSED = radians(190.0)  # a pin cannot leave a hole with a larger span: that is a joint, or none
_INSIDE = 0.02  # rad from the edge of a rounding: anything closer belongs to the adjacent face
_UPRIGHT = 0.9  # cosine between the normal of a free-form face and the direction to a round one
_STATIONS = 41  # number along a cylinder
_ON_AXIS = 1e-3  # mm


@dataclass(frozen=True, eq=False)
class NearestPlace:
    """The place where a round face is nearest to another, as stored in `engine.cad.findings.FacingRound`."""

    gap: float
    middle: Array
    normal: Array
    stretch: Array
    is_estimate: bool = False


def nearest_place(
    face: CadFace, other: CadFace, triangles: dict[int, Array], sags: tuple[float, float]
) -> NearestPlace | None:
    """Return where a round face is nearest to another; None if that is not inside both, up to the sag of triangles."""
    ways = _BALL if face.kind == "sphere" else _ROLLER
    way = ways.get(other.kind)
    pair = way(face, other, triangles[other.number]) if way else None
    if pair is None:
        return None
    if face.kind == "cylinder":
        return pair if _covers(face, -pair.normal) and np.ptp(pair.stretch) >= LEAST_LENGTH else None
    touching = pair.middle + pair.gap * pair.normal, pair.middle
    far = (distance_to_triangles(at, triangles[each.number]) for at, each in zip(touching, (face, other), strict=True))
    return pair if all(distance <= sag for distance, sag in zip(far, sags, strict=True)) else None


def _covers(face: CadFace, direction: Array) -> bool:
    """Return whether a cylinder extends to both sides of a direction from its axis."""
    if face.span >= WHOLE:
        return True
    half = face.span / 2 - _INSIDE
    return bool(half > 0 and direction @ face.middle > np.cos(half))


def _roller_on_plane(roller: CadFace, plane: CadFace, corners: Array) -> NearestPlace | None:
    """Return where a cylinder lying along a plane is nearest to it."""
    normal = plane.axis
    if abs(roller.axis @ normal) > _PARALLEL:
        return None
    height = float((roller.point - plane.point) @ normal)
    stations = np.linspace(roller.extent[0], roller.extent[1], _STATIONS)
    foot = roller.point - height * normal
    inside = stations[contains(corners, foot + np.outer(stations, roller.axis), normal)]
    if not len(inside):
        return None
    middle = foot + _middle(inside) * roller.axis
    return NearestPlace(height - roller.radius, middle, normal, np.array([inside.min(), inside.max()]))


def _middle(inside: Array) -> float:
    """Return the station inside a face that is nearest to the middle of all of them."""
    return float(inside[np.abs(inside - (inside.min() + inside.max()) / 2).argmin()])


def _roller_on_cylinder(roller: CadFace, other: CadFace, _: Array) -> NearestPlace | None:
    """Return where a cylinder is nearest to a parallel one, or to one that surrounds it without closing."""
    away = roller.point - other.point
    along = float(away @ other.axis)
    across = away - along * other.axis
    far = float(np.linalg.norm(across))
    if abs(roller.axis @ other.axis) < np.cos(_PARALLEL) or far < _ON_AXIS:
        return None
    if other.hollow and (other.span > _CLOSED or other.radius <= roller.radius):
        return None
    outward = across / far
    stations = (other.point + np.outer(other.extent, other.axis) - roller.point) @ roller.axis
    stretch = np.array([max(roller.extent[0], stations.min()), min(roller.extent[1], stations.max())])
    if stretch[1] <= stretch[0] or not _covers(other, outward):
        return None
    middle = other.point + other.radius * outward + (along + stretch.mean() * (roller.axis @ other.axis)) * other.axis
    gap = other.radius - roller.radius - far if other.hollow else far - roller.radius - other.radius
    return NearestPlace(gap, middle, -outward if other.hollow else outward, stretch)


def _roller_on_surface(roller: CadFace, _: CadFace, corners: Array) -> NearestPlace | None:
    """Return where a cylinder is nearest to the triangles of a free-form face along it."""
    stations = np.linspace(roller.extent[0], roller.extent[1], _STATIONS)
    points = roller.point + np.outer(stations, roller.axis)
    found = [nearest_on_triangles(point, corners) for point in points]
    far = np.array([np.linalg.norm(point - at) for point, (at, _) in zip(points, found, strict=True)])
    near = stations[far <= far.min() + _ON_AXIS]
    i = int(np.abs(stations - _middle(near)).argmin())
    pair = _on_triangles(points[i], roller.radius, *found[i], corners)
    if pair is None or abs(pair.normal @ roller.axis) > _INSIDE:
        return None
    return NearestPlace(pair.gap, pair.middle, pair.normal, np.array([near.min(), near.max()]), is_estimate=True)


def _ball_on_plane(ball: CadFace, plane: CadFace, corners: Array) -> NearestPlace | None:
    height = float((ball.point - plane.point) @ plane.axis)
    foot = ball.point - height * plane.axis
    if not contains(corners, foot[None], plane.axis)[0]:
        return None
    return NearestPlace(height - ball.radius, foot, plane.axis, np.zeros(2))


def _ball_on_cylinder(ball: CadFace, other: CadFace, _: Array) -> NearestPlace | None:
    along = float((ball.point - other.point) @ other.axis)
    return _ball_round(ball, other, other.point + along * other.axis)


def _ball_on_sphere(ball: CadFace, other: CadFace, _: Array) -> NearestPlace | None:
    return _ball_round(ball, other, other.point)


def _ball_round(ball: CadFace, other: CadFace, centre: Array) -> NearestPlace | None:
    """Return where a ball is nearest to the round face about a centre, from outside or inside."""
    if other.hollow and other.radius <= ball.radius:
        return None
    across = ball.point - centre
    far = float(np.linalg.norm(across))
    outward = across / far if far > _ON_AXIS else _towards(other)
    gap = other.radius - ball.radius - far if other.hollow else far - ball.radius - other.radius
    return NearestPlace(gap, centre + other.radius * outward, -outward if other.hollow else outward, np.zeros(2))


def _towards(other: CadFace) -> Array:
    """Return any direction from an axis to the face about it, for a point equally near on all sides."""
    if other.middle.any():
        return other.middle
    return np.asarray(perpendicular(other.axis)[0] if other.axis.any() else -other.normal)


def _ball_on_cone(ball: CadFace, cone: CadFace, _: Array) -> NearestPlace | None:
    """Return where a ball is nearest to a cone; if it is on the axis, one of the places around it."""
    away = ball.point - cone.point
    along = float(away @ cone.axis)
    across = away - along * cone.axis
    far = float(np.linalg.norm(across))
    outward = across / far if far > _ON_AXIS else _towards(cone)
    sine, cosine = np.sin(cone.half_angle), np.cos(cone.half_angle)
    height = (far - cone.radius) * cosine - along * sine  # above the flank, outside the cone
    slope = cosine * outward - sine * cone.axis
    side = -1.0 if cone.hollow else 1.0
    return NearestPlace(side * height - ball.radius, ball.point - height * slope, side * slope, np.zeros(2))


def _ball_on_surface(ball: CadFace, _: CadFace, corners: Array) -> NearestPlace | None:
    return _on_triangles(ball.point, ball.radius, *nearest_on_triangles(ball.point, corners), corners)


def _on_triangles(point: Array, radius: float, at: Array, row: int, corners: Array) -> NearestPlace | None:
    """Return where a round face about a point is nearest to triangles; None if behind them or beyond their edge."""
    first, second, third = corners[row]
    normal = np.cross(second - first, third - first)
    away = point - at
    far = float(np.linalg.norm(away))
    if far < _ON_AXIS or away @ normal < _UPRIGHT * far * np.linalg.norm(normal):
        return None
    return NearestPlace(far - radius, at, away / far, np.zeros(2), is_estimate=True)


_Way = Callable[[CadFace, CadFace, Array], NearestPlace | None]
_ROLLER: dict[str, _Way] = {
    "plane": _roller_on_plane,
    "cylinder": _roller_on_cylinder,
    "surface": _roller_on_surface,
}
_BALL: dict[str, _Way] = {
    "plane": _ball_on_plane,
    "cylinder": _ball_on_cylinder,
    "sphere": _ball_on_sphere,
    "cone": _ball_on_cone,
    "torus": _ball_on_surface,
    "surface": _ball_on_surface,
}
