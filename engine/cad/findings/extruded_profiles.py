"""The closed profile of lines and arcs of a part in a plane perpendicular to an axis: of a cam, a hook, a ratchet."""

from dataclasses import dataclass, replace
from itertools import pairwise
from math import tau

import numpy as np

from engine.arrays import Array
from engine.cad.cad_model import CadAssembly, CadFace, Coordinates, Millimetres
from engine.cad.geometry import perpendicular

MOST_PIECES = 24
"""Most lines and arcs of a profile; a contour with more is named by its face."""
_ALONG = 1e-6  # rad between an axis and faces parallel to it
_CLOSE = 1e-5  # mm between two ends that coincide
_TANGENT = 1e-3  # rad between two pieces that continue smoothly


@dataclass(frozen=True, eq=False, kw_only=True)
class ProfilePiece:
    """A line, or an arc about a centre that turns left or right."""

    face: int
    """Number of the face whose section it is."""
    start: Coordinates
    """Shape (2,) [mm]."""
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
    along: Array
    """The direction of the profile's x; y is perpendicular to the axis and to x."""
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
    if ring is None or len(ring) > MOST_PIECES:
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
