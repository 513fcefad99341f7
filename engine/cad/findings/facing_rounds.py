"""Round faces that may touch a face of another part: noses of hooks, rollers, cams and balls.

A round face, i.e. a convex cylinder or a ball, may touch another one at the place where it is nearest to it. If it
could move on to the next face there, what it touches is a profile: the closed curve of lines and arcs in which a plane
perpendicular to an axis cuts a part, such as a cam, a hook or a ratchet.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from itertools import pairwise
from math import radians, tau

import numpy as np

from engine.arrays import Array
from engine.cad.cad_model import CadAssembly, CadFace, Coordinates, Millimetres
from engine.cad.findings.facing_planes import DEEPEST_OVERLAP, REACH, contains
from engine.cad.geometry import distance_to_triangles, nearest_on_triangles, perpendicular

_MOST_PIECES = 24  # most lines and arcs of a profile; a contour with more is named by its face
_ALONG = 1e-6  # rad between an axis and faces parallel to it
_CLOSE = 1e-5  # mm between two ends that coincide
_TANGENT = 1e-3  # rad between two pieces that continue smoothly


@dataclass(frozen=True, eq=False, kw_only=True)
class ProfilePiece:
    """A line, or an arc about a centre that turns left or right."""

    face: int  # number of the face whose section it is
    start: Coordinates  # shape (2,) [mm]
    end: Coordinates
    centre: Coordinates | None = None
    left: bool = True

    def seen_from(self, origin: Array) -> "ProfilePiece":
        """Return the piece with its points relative to an origin in the plane, shape (2,)."""
        centre = None if self.centre is None else self.centre - origin
        return replace(self, start=self.start - origin, end=self.end - origin, centre=centre)

    def direction(self, at: Array) -> Array:
        """Return the unit direction of travel at one of its ends, shape (2,)."""
        away = self.end - self.start if self.centre is None else _turned(at - self.centre) * (1 if self.left else -1)
        return np.asarray(away / np.linalg.norm(away))


@dataclass(frozen=True, eq=False, kw_only=True)
class ExtrudedProfile:
    """A closed profile, with the material on its left, and how far its faces extend along an axis."""

    point: Coordinates
    """The origin of the profile [mm]: in the middle of its length, on the line parallel to the axis through the part's
    origin.
    """
    axis: Array
    along: Array  # the direction of the profile's x; y is perpendicular to the axis and to x
    half_length: Millimetres
    pieces: tuple[ProfilePiece, ...]

    def is_smooth_at(self, face: int) -> bool:
        """Return whether the section of a face continues smoothly into an arc, or is an arc that continues smoothly."""
        ring = [*self.pieces, self.pieces[0]]
        return any(
            face in (one.face, other.face)
            and (one.centre is not None or other.centre is not None)
            and one.direction(one.end) @ other.direction(other.start) > np.cos(_TANGENT)
            for one, other in pairwise(ring)
        )


def extruded_profile(
    assembly: CadAssembly, triangles: dict[int, Array], face: CadFace, axis: Array, at: Array
) -> ExtrudedProfile | None:
    """Return the closed profile of a part in the plane perpendicular to an axis through a point; None if there is none.

    The profile passes through the face, a plane parallel to the axis or a cylinder about a parallel one; `at` is a
    point of it in the plane of the section, shape (3,) [mm]. Triangles are those of `triangles_by_face`.
    """
    frame, station = perpendicular(axis), float(at @ axis)
    own = [each for each in assembly.faces_of(face.part) if each.solid == face.solid and each.number in triangles]
    pieces: list[ProfilePiece] = []
    for each in own:
        if _goes_along(each, axis):
            pieces += _section(each, triangles[each.number], (frame, axis, station))
    ring = _ring(pieces, face.number)
    if ring is None or len(ring) > _MOST_PIECES:
        return None
    origin = assembly.part(face.part).placement.translation
    heights = [triangles[piece.face].reshape(-1, 3) @ axis for piece in ring]
    low, high = max(each.min() for each in heights), min(each.max() for each in heights)
    return ExtrudedProfile(
        point=origin + (float(low + high) / 2 - origin @ axis) * axis,
        axis=axis,
        along=frame[0],
        half_length=float(high - low) / 2,
        pieces=tuple(piece.seen_from(frame @ origin) for piece in ring),
    )


def _goes_along(face: CadFace, axis: Array) -> bool:
    """Return whether a plane or a cylinder is parallel to an axis."""
    if face.kind == "plane":
        return bool(abs(face.axis @ axis) < _ALONG)
    return face.kind == "cylinder" and bool(np.linalg.norm(np.cross(face.axis, axis)) < _ALONG)


def _section(face: CadFace, corners: Array, where: tuple[Array, Array, float]) -> list[ProfilePiece]:
    """Return the pieces in which the plane at a station cuts a face, with the material on the left."""
    frame, axis, station = where
    cuts = _cuts(corners, axis, station) @ frame.T
    if not len(cuts):
        return []
    if face.kind == "plane":
        way = _turned(frame @ face.axis)  # the normal points to the right
        spans = _merged(np.sort(cuts @ way, axis=1), _CLOSE)
        foot = frame @ face.point
        foot = foot - (foot @ way) * way
        return [ProfilePiece(face=face.number, start=foot + a * way, end=foot + b * way) for a, b in spans]
    centre = frame @ face.point
    angles = np.arctan2(*np.moveaxis(cuts - centre, 2, 0)[::-1])
    turns = (angles[:, 1] - angles[:, 0] + tau / 2) % tau - tau / 2
    starts = np.where(turns < 0, angles[:, 1], angles[:, 0])
    spans = _joined_round(_merged(np.column_stack([starts, starts + np.abs(turns)]), _CLOSE / face.radius))
    ends = [(centre + face.radius * _unit(a), centre + face.radius * _unit(b)) for a, b in spans if b - a < tau - 1e-6]
    return [
        ProfilePiece(face=face.number, start=b, end=a, centre=centre, left=False)
        if face.hollow
        else ProfilePiece(face=face.number, start=a, end=b, centre=centre)
        for a, b in ends
    ]


def _cuts(corners: Array, axis: Array, station: float) -> Array:
    """Return the segments in which the plane at a station cuts triangles, shape (n, 2, 3)."""
    heights = corners @ axis - station
    # a corner in the plane counts as above it, so that each triangle is cut at two sides or at none
    heights = np.where(heights == 0, 1e-12, heights)
    found = []
    for triangle, above in zip(corners, heights, strict=True):
        ends = [
            triangle[i] + above[i] / (above[i] - above[j]) * (triangle[j] - triangle[i])
            for i, j in ((0, 1), (1, 2), (2, 0))
            if above[i] * above[j] < 0
        ]
        if len(ends) == 2:
            found.append(ends)
    return np.array(found).reshape(-1, 2, 3)


def _merged(spans: Array, close: float) -> list[list[float]]:
    """Return the union of intervals, shape (n, 2), joining those that nearly touch."""
    merged: list[list[float]] = []
    for start, end in spans[np.argsort(spans[:, 0])].tolist():
        if merged and start <= merged[-1][1] + close:
            merged[-1][1] = max(merged[-1][1], end)
        else:
            merged.append([start, end])
    return merged


def _joined_round(spans: list[list[float]]) -> list[list[float]]:
    """Return intervals of angles, with the last joined to the first if they meet."""
    if len(spans) > 1 and spans[0][0] + tau <= spans[-1][1] + 1e-6:
        return [*spans[1:-1], [spans[-1][0], spans[0][1] + tau]]
    return spans


def _ring(pieces: list[ProfilePiece], face: int) -> list[ProfilePiece] | None:
    """Return the pieces of a closed curve through a face, each starting where the previous one ends; None if open."""
    first = next((piece for piece in pieces if piece.face == face), None)
    if first is None:
        return None
    ring = [first]
    while np.linalg.norm(ring[-1].end - first.start) > _CLOSE or len(ring) == 1:
        ahead = [p for p in pieces if np.linalg.norm(p.start - ring[-1].end) <= _CLOSE and p not in ring]
        # a gap, or a fork at which nothing says where the profile goes on
        if len(ahead) != 1:
            return None
        ring.append(ahead[0])
    return ring


def _turned(vector: Array) -> Array:
    """Return a vector in the plane, rotated left by a right angle."""
    return np.array([-vector[1], vector[0]])


def _unit(angle: float) -> Array:
    return np.array([np.cos(angle), np.sin(angle)])


_LEAST_LENGTH = 0.2  # mm, of a line along which a cylinder may touch; shorter is a corner of one face over another
WHOLE = tau - 0.01  # smallest span of a cylinder [rad] that counts as a full turn
_PARALLEL = 1e-3  # rad
_CLOSED = radians(190.0)  # a pin cannot leave a hole with a larger span: that is a joint, or none
_INSIDE = 0.02  # rad from the edge of a rounding: anything closer belongs to the adjacent face
_UPRIGHT = 0.9  # cosine between the normal of a free-form face and the direction to a round one
_STATIONS = 41  # number along a cylinder
_ON_AXIS = 1e-3  # mm


@dataclass(frozen=True, eq=False, kw_only=True)
class FacingRound:
    """A convex round face opposite a face of another part."""

    faces: tuple[int, int]  # numbers of the touched face and of the round one
    parts: tuple[str, str]  # names of the parts, in the same order
    gap: Millimetres  # distance as posed [mm]; negative where the parts overlap
    middle: Coordinates  # the nearest point on the first face, shape (3,) [mm]
    normal: Array  # normal of the first face at that point, towards the second, shape (3,)
    # start and end of the line of possible contact along the axis of a cylinder, measured from its point, shape (2,);
    # zeros for a ball
    stretch: Coordinates
    is_estimate: bool = False  # whether the gap was measured to the triangles of a free-form face
    profile: ExtrudedProfile | None = None  # of which the touched face is a piece; None: the face ends at an edge

    @property
    def length(self) -> float:
        """Length of the line along which a cylinder may touch [mm]; 0 for a ball."""
        return float(np.ptp(self.stretch))


def _nearest(
    face: CadFace, other: CadFace, triangles: dict[int, Array], sags: tuple[float, float]
) -> FacingRound | None:
    """Return where a round face is nearest to another; None if that is not inside both, up to the sag of triangles."""
    way = _WAYS.get((face.kind, other.kind))
    pair = way(face, other, triangles[other.number]) if way else None
    if pair is None:
        return None
    if face.kind == "cylinder":
        return pair if _covers(face, -pair.normal) and np.ptp(pair.stretch) >= _LEAST_LENGTH else None
    touching = pair.middle + pair.gap * pair.normal, pair.middle
    far = (distance_to_triangles(at, triangles[each.number]) for at, each in zip(touching, (face, other), strict=True))
    return pair if all(distance <= sag for distance, sag in zip(far, sags, strict=True)) else None


def _facing(
    face: CadFace, other: CadFace, gap: float, middle: Array, normal: Array, stretch: Array | None = None
) -> FacingRound:
    """Return a round face opposite another one; a ball has no stretch."""
    stretch = np.zeros(2) if stretch is None else stretch
    faces, parts = (other.number, face.number), (other.part, face.part)
    return FacingRound(faces=faces, parts=parts, gap=gap, middle=middle, normal=normal, stretch=stretch)


def _covers(face: CadFace, direction: Array) -> bool:
    """Return whether a cylinder extends to both sides of a direction from its axis."""
    if face.span >= WHOLE:
        return True
    half = face.span / 2 - _INSIDE
    return bool(half > 0 and direction @ face.middle > np.cos(half))


def _roller_on_plane(roller: CadFace, plane: CadFace, corners: Array) -> FacingRound | None:
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
    return _facing(roller, plane, height - roller.radius, middle, normal, np.array([inside.min(), inside.max()]))


def _middle(inside: Array) -> float:
    """Return the station inside a face that is nearest to the middle of all of them."""
    return float(inside[np.abs(inside - (inside.min() + inside.max()) / 2).argmin()])


def _roller_on_cylinder(roller: CadFace, other: CadFace, _: Array) -> FacingRound | None:
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
    return _facing(roller, other, gap, middle, -outward if other.hollow else outward, stretch)


def _roller_on_surface(roller: CadFace, other: CadFace, corners: Array) -> FacingRound | None:
    """Return where a cylinder is nearest to the triangles of a free-form face along it."""
    stations = np.linspace(roller.extent[0], roller.extent[1], _STATIONS)
    points = roller.point + np.outer(stations, roller.axis)
    found = [nearest_on_triangles(point, corners) for point in points]
    far = np.array([np.linalg.norm(point - at) for point, (at, _) in zip(points, found, strict=True)])
    near = stations[far <= far.min() + _ON_AXIS]
    i = int(np.abs(stations - _middle(near)).argmin())
    pair = _on_triangles(roller, other, points[i], *found[i], corners)
    if pair is None or abs(pair.normal @ roller.axis) > _INSIDE:
        return None
    return replace(pair, stretch=np.array([near.min(), near.max()]))


def _ball_on_plane(ball: CadFace, plane: CadFace, corners: Array) -> FacingRound | None:
    height = float((ball.point - plane.point) @ plane.axis)
    foot = ball.point - height * plane.axis
    inside = contains(corners, foot[None], plane.axis)[0]
    return _facing(ball, plane, height - ball.radius, foot, plane.axis) if inside else None


def _ball_on_round(ball: CadFace, other: CadFace, _: Array) -> FacingRound | None:
    """Return where a ball is nearest to a cylinder or a sphere, from outside or inside."""
    if other.hollow and other.radius <= ball.radius:
        return None
    centre = other.point
    if other.kind == "cylinder":
        centre = centre + float((ball.point - centre) @ other.axis) * other.axis
    across = ball.point - centre
    far = float(np.linalg.norm(across))
    outward = across / far if far > _ON_AXIS else _towards(other)
    gap = other.radius - ball.radius - far if other.hollow else far - ball.radius - other.radius
    return _facing(ball, other, gap, centre + other.radius * outward, -outward if other.hollow else outward)


def _towards(other: CadFace) -> Array:
    """Return any direction from an axis to the face about it, for a point equally near on all sides."""
    if other.middle.any():
        return other.middle
    return np.asarray(perpendicular(other.axis)[0] if other.axis.any() else -other.normal)


def _ball_on_cone(ball: CadFace, cone: CadFace, _: Array) -> FacingRound | None:
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
    return _facing(ball, cone, side * height - ball.radius, ball.point - height * slope, side * slope)


def _ball_on_surface(ball: CadFace, other: CadFace, corners: Array) -> FacingRound | None:
    return _on_triangles(ball, other, ball.point, *nearest_on_triangles(ball.point, corners), corners)


def _on_triangles(
    face: CadFace, other: CadFace, point: Array, at: Array, row: int, corners: Array
) -> FacingRound | None:
    """Return where a round face about a point is nearest to triangles; None if behind them or beyond their edge."""
    first, second, third = corners[row]
    normal = np.cross(second - first, third - first)
    away = point - at
    far = float(np.linalg.norm(away))
    if far < _ON_AXIS or away @ normal < _UPRIGHT * far * np.linalg.norm(normal):
        return None
    return replace(_facing(face, other, far - face.radius, at, away / far), is_estimate=True)


_WAYS: dict[tuple[str, str], Callable[[CadFace, CadFace, Array], FacingRound | None]] = {
    ("cylinder", "plane"): _roller_on_plane,
    ("cylinder", "cylinder"): _roller_on_cylinder,
    ("cylinder", "surface"): _roller_on_surface,
    ("sphere", "plane"): _ball_on_plane,
    ("sphere", "cylinder"): _ball_on_round,
    ("sphere", "sphere"): _ball_on_round,
    ("sphere", "cone"): _ball_on_cone,
    ("sphere", "torus"): _ball_on_surface,
    ("sphere", "surface"): _ball_on_surface,
}


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
            pair = _nearest(face, other, triangles, (sags[face.part], sags[other.part]))
            if pair is None or not -DEEPEST_OVERLAP <= pair.gap <= REACH:
                continue
            profile = _profile(assembly, triangles, face, other, pair.middle)
            if profile is not None or _has_a_primitive(other):
                found.append(replace(pair, profile=profile))
    # of the candidates that share round face and profile, the first
    kept: dict[tuple[int, frozenset[int]], FacingRound] = {}
    for each in sorted(found, key=lambda each: (each.gap, each.faces)):
        pieces = each.profile.pieces if each.profile else ()
        kept.setdefault((each.faces[1], frozenset(piece.face for piece in pieces) or frozenset(each.faces)), each)
    return list(kept.values())


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
    if other.splines or other.kind in ("plane", "sphere") or (other.kind == "cylinder" and not other.hollow):
        return True
    return other.kind in ("cylinder", "cone") and other.span >= WHOLE


def _is_first(other: CadFace, face: CadFace) -> bool:
    """Return whether the other of two convex faces is the round one of the pair: a ball, a roller, the smaller one."""
    if other.hollow or other.kind not in ("cylinder", "sphere"):
        return False
    first, second = ((f.kind != "sphere", f.span < WHOLE, f.radius, f.number) for f in (other, face))
    return first < second
