"""Round faces that may touch a face of another part: noses of hooks, rollers, cams and balls.

A round face, i.e. a convex cylinder or a ball, may touch another one at the place where it is nearest to it.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from math import radians, tau
from typing import Annotated

import numpy as np

from engine.arrays import Array
from engine.cad.cad_model import CadAssembly, CadFace, Coordinates, LengthPower, Millimetres
from engine.cad.findings.extruded_profiles import ExtrudedProfile, extruded_profile
from engine.cad.findings.facing_planes import DEEPEST_OVERLAP, REACH, contains
from engine.cad.geometry import distance_to_triangles, nearest_on_triangles, perpendicular

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

Stretch = Annotated[Array, LengthPower(1)]


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


@dataclass(frozen=True, eq=False, kw_only=True)
class FacingRound:
    """A convex round face opposite a face of another part."""

    faces: tuple[int, int]
    """Numbers of the touched face and of the round one."""
    parts: tuple[str, str]
    """Names of the parts, in the same order."""
    gap: Millimetres
    """Distance as posed [mm]; negative where the parts overlap."""
    middle: Coordinates
    """The nearest point on the first face, shape (3,) [mm]."""
    normal: Array
    """Normal of the first face at that point, towards the second, shape (3,)."""
    stretch: Stretch
    """Start and end of the line of possible contact along the axis of a cylinder, measured from its point, shape (2,)
    [mm]; zeros for a sphere.
    """
    is_estimate: bool = False
    """Whether the gap was measured to the triangles of a free-form face."""
    profile: ExtrudedProfile | None = None
    """The profile of which the touched face is a piece, if the round face could move on to the next piece."""

    @property
    def length(self) -> float:
        """Length of the line along which a cylinder may touch [mm]; 0 for a ball."""
        return float(np.ptp(self.stretch))


def facing_rounds(
    assembly: CadAssembly, triangles: dict[int, Array], joints: Collection[frozenset[int]] = ()
) -> list[FacingRound]:
    """Return the convex cylinders and balls at most 1 mm from a face of another part, the smallest gap first.

    A cylinder is paired with planes, cylinders and free-form faces along its axis, a ball with faces of any kind. The
    closest points must lie inside both faces, not on an edge to the next face.

    `joints` has the numbers of the two faces of each pair that is a joint; these pairs are skipped.
    """
    faces = [face for face in assembly.faces if face.number in triangles]
    rounds = [face for face in faces if face.kind in ("cylinder", "sphere") and not face.hollow]
    boxes = np.array([_box(triangles[face.number]) for face in faces]).reshape(-1, 2, 3)
    sags = {mesh.part: 2 * mesh.deflection + 1e-6 for mesh in assembly.meshes}
    found = []
    for face in rounds:
        low, high = _box(triangles[face.number])
        near = ((boxes[:, 0] <= high + REACH) & (boxes[:, 1] >= low - REACH)).all(axis=1)
        for other in (faces[i] for i in np.flatnonzero(near).tolist()):
            if other.part == face.part or frozenset((face.number, other.number)) in joints or _is_first(other, face):
                continue
            pair = nearest_place(face, other, triangles, (sags[face.part], sags[other.part]))
            if pair is None or not -DEEPEST_OVERLAP <= pair.gap <= REACH:
                continue
            profile = _profile(assembly, triangles, face, other, pair.middle)
            if profile is not None or _has_a_primitive(other):
                found.append(_facing(face, other, pair, profile))
    return _one_of_each_profile(sorted(found, key=lambda each: (each.gap, each.faces)))


def _box(corners: Array) -> Array:
    """Return the smallest and largest coordinates of triangles, shape (2, 3)."""
    points = corners.reshape(-1, 3)
    return np.array([points.min(axis=0), points.max(axis=0)])


def _profile(
    assembly: CadAssembly, triangles: dict[int, Array], face: CadFace, other: CadFace, at: Array
) -> ExtrudedProfile | None:
    """Return the profile that continues smoothly beyond the touched face, or is hollow there."""
    if other.kind == "cylinder" and other.span < WHOLE:
        return extruded_profile(assembly, triangles, other, other.axis, at)
    if other.kind == "plane" and face.kind == "cylinder":
        profile = extruded_profile(assembly, triangles, other, face.axis, at)
        return profile if profile is not None and profile.is_smooth_at(other.number) else None
    return None


def _has_a_primitive(other: CadFace) -> bool:
    """Return whether a single face can be written in a mechanism file: by its splines, or as a closed round solid."""
    if other.splines or other.kind in ("plane", "sphere"):
        return True
    if other.kind == "cylinder" and not other.hollow:
        return True
    return other.kind in ("cylinder", "cone") and other.span >= WHOLE


def _one_of_each_profile(found: list[FacingRound]) -> list[FacingRound]:
    """Return the candidates without those that share round face and profile with an earlier one."""
    kept: dict[tuple[int, frozenset[int]], FacingRound] = {}
    for each in found:
        pieces = each.profile.pieces if each.profile else ()
        kept.setdefault((each.faces[1], frozenset(piece.face for piece in pieces) or frozenset(each.faces)), each)
    return list(kept.values())


def _facing(face: CadFace, other: CadFace, pair: NearestPlace, profile: ExtrudedProfile | None) -> FacingRound:
    return FacingRound(
        faces=(other.number, face.number),
        parts=(other.part, face.part),
        gap=pair.gap,
        middle=pair.middle,
        normal=pair.normal,
        stretch=pair.stretch,
        is_estimate=pair.is_estimate,
        profile=profile,
    )


def _is_first(other: CadFace, face: CadFace) -> bool:
    """Return whether the other of two convex faces is the round one of the pair: a ball, a roller, the smaller one."""
    if other.hollow or other.kind not in ("cylinder", "sphere"):
        return False
    return _rank(other) < _rank(face)


def _rank(face: CadFace) -> tuple[bool, bool, float, int]:
    return face.kind != "sphere", face.span < WHOLE, face.radius, face.number
