"""Merge pieces of one surface into one face, and arcs of one circle into one edge.

Many CAD systems cut a bore and the circle at its end into halves, or a plane where parts touch.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import pi, tau
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from engine.arrays import Array, Integers
from engine.cad.cad_model import CadEdge, CadFace, FaceKind, SplineSurface
from engine.cad.geometry import covered, perpendicular

_CORNER = 1e-5  # mm between two corners that coincide
_NEAR = 1e-2  # mm between the features of two pieces or arcs that may be merged
_SAME = 1e-6  # mm between two surfaces or circles that are one, besides their recognition gaps


@dataclass(frozen=True, eq=False, kw_only=True)
class FacePiece:
    """A face as given in the file, in the frame of its product; lengths in mm."""

    solid: int
    kind: FaceKind
    point: Array
    """Any point of the axis (cylinder, cone), the centre (sphere, torus), otherwise a point of the face, shape (3,)."""
    axis: Array
    radius: float = 0.0
    minor_radius: float = 0.0
    half_angle: float = 0.0
    area: float
    on: Array
    normal: Array
    """Outward normal at `on`."""
    recognition_gap: float = 0.0
    splines: tuple[SplineSurface, ...] = ()
    vertices: Array = field(repr=False)
    """Vertices of its triangles, shape (n, 3)."""
    triangles: Integers = field(repr=False)
    """Row indices into `vertices`, shape (m, 3)."""


def merge_pieces(pieces: list[FacePiece], part: str) -> tuple[list[CadFace], Integers]:
    """Return the faces of a part, and for each piece the number of its face."""
    near = _NEAR + 2 * max((piece.recognition_gap for piece in pieces), default=0.0)
    features = np.array([_features(piece) for piece in pieces]).reshape(-1, 6)
    groups = groups_of_one(features, near, lambda a, b: _is_one_surface(pieces[a], pieces[b]))
    numbers = np.zeros(len(pieces), np.int64)
    for number, group in enumerate(groups):
        numbers[group] = number
    return [_face([pieces[i] for i in group], part, number) for number, group in enumerate(groups)], numbers


def _features(piece: FacePiece) -> Array:
    """Return numbers that are equal for two pieces of one surface: its kind, size and position [mm]."""
    foot = piece.point - (piece.point @ piece.axis) * piece.axis  # the point of the axis nearest to the origin
    where = {
        "plane": (*piece.axis, piece.point @ piece.axis),
        "cylinder": (*foot, piece.radius),
        "cone": (*foot, piece.half_angle),
    }
    kind = get_args(FaceKind).index(piece.kind)
    return np.array([piece.solid, kind, *where.get(piece.kind, (*piece.point, piece.radius))])


def _is_one_surface(a: FacePiece, b: FacePiece) -> bool:
    """Return whether two pieces lie on the same side of the same surface, and meet along its axis."""
    if (a.solid, a.kind) != (b.solid, b.kind) or a.kind == "surface":
        return False
    allowed = _SAME + a.recognition_gap + b.recognition_gap
    size = max(np.ptp(a.vertices, axis=0).max(), np.ptp(b.vertices, axis=0).max())
    # as a distance, like the other differences: by how much the axes part over the length of the pieces
    tilt = float(np.linalg.norm(np.cross(a.axis, b.axis))) * size
    if a.kind == "plane":
        level = tilt <= allowed and a.axis @ b.axis > 0 and abs((b.point - a.point) @ a.axis) <= allowed
        return bool(level) and _share_corners(a, b)
    apart = [abs(a.radius - _radius_at(b, a.point)), abs(a.minor_radius - b.minor_radius)]
    apart.append(abs(a.half_angle - b.half_angle) * size)
    apart.append(tilt)
    between = b.point - a.point
    along = between @ a.axis if a.kind in ("cylinder", "cone") else 0.0
    apart.append(float(np.linalg.norm(between - along * a.axis)))
    if max(apart) > allowed or _hollow(a) != _hollow(b) or (a.kind == "cone" and a.axis @ b.axis < 0):
        return False
    return a.kind in ("sphere", "torus") or _meet(a, b, allowed)


def _meet(a: FacePiece, b: FacePiece, allowed: float) -> bool:
    """Return whether two pieces with a common axis overlap or touch along it."""
    first, second = (a.vertices - a.point) @ a.axis, (b.vertices - a.point) @ a.axis
    return bool(first.min() <= second.max() + allowed and second.min() <= first.max() + allowed)


def _share_corners(a: FacePiece, b: FacePiece) -> bool:
    """Return whether two pieces share at least two corners of triangles, and so an edge."""
    first, second = ({tuple(corner) for corner in (piece.vertices / _CORNER).round().tolist()} for piece in (a, b))
    return len(first & second) > 1


def _radius_at(piece: FacePiece, point: Array) -> float:
    """Return the radius of a piece at the height of a point; it varies only on a cone."""
    return piece.radius + float((point - piece.point) @ piece.axis) * float(np.tan(piece.half_angle))


def _hollow(piece: FacePiece) -> bool:
    """Return whether the outward normal points to the axis, the centre or the middle of the tube."""
    away = piece.on - piece.point
    if piece.kind != "sphere":
        away = away - (away @ piece.axis) * piece.axis
    if piece.kind == "torus":
        away = piece.on - piece.point - piece.radius * away / np.linalg.norm(away)
    return piece.kind not in ("plane", "surface") and bool(away @ piece.normal < 0)


def _face(pieces: list[FacePiece], part: str, number: int) -> CadFace:
    """Return the face made up of pieces."""
    first = max(pieces, key=lambda piece: piece.area)
    face = CadFace(
        number=number,
        part=part,
        solid=first.solid,
        kind=first.kind,
        point=first.point,
        axis=first.axis,
        radius=first.radius,
        minor_radius=first.minor_radius,
        half_angle=first.half_angle,
        hollow=_hollow(first),
        area=sum(piece.area for piece in pieces),
        on=first.on,
        normal=first.normal,
        recognition_gap=max(piece.recognition_gap for piece in pieces),
        splines=_splines(pieces),
    )
    if first.kind in ("plane", "surface"):
        return face
    return _with_extent(face, pieces)


def _splines(pieces: list[FacePiece]) -> tuple[SplineSurface, ...]:
    """Return the B-splines of all pieces; none if one of the pieces has none."""
    if not all(piece.splines for piece in pieces):
        return ()
    return tuple(spline for piece in pieces for spline in piece.splines)


def _with_extent(face: CadFace, pieces: list[FacePiece]) -> CadFace:
    """Return a face with the angle and the axial length covered by the triangles of its pieces."""
    axis = face.axis if face.kind != "sphere" else np.array([0.0, 0.0, 1.0])
    frame = perpendicular(axis)
    local = [piece.vertices - face.point for piece in pieces]
    angles = [np.arctan2(each @ frame[1], each @ frame[0]) for each in local]
    corners = np.concatenate([angle[piece.triangles] for angle, piece in zip(angles, pieces, strict=True)])
    away = [np.hypot(each @ frame[1], each @ frame[0]) for each in local]
    on_axis = np.concatenate([far[piece.triangles] for far, piece in zip(away, pieces, strict=True)]) < 1e-9 * (
        1.0 + face.radius
    )
    span, middle = covered(*_intervals(corners, on_axis))
    heights = np.concatenate([each @ axis for each in local])
    low, high = float(heights.min()), float(heights.max())
    towards = np.cos(middle) * frame[0] + np.sin(middle) * frame[1] if span < tau - 1e-6 else np.zeros(3)
    if face.kind not in ("cylinder", "cone"):
        return replace(face, span=span, middle=towards, extent=np.array([low, high]))
    half, centre = (high - low) / 2, (high + low) / 2
    return replace(
        face,
        point=face.point + centre * axis,
        radius=face.radius + centre * float(np.tan(face.half_angle)),
        span=span,
        middle=towards,
        extent=np.array([-half, half]),
    )


def _intervals(corners: Array, on_axis: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return the interval of angles that each triangle covers; a corner on the axis has no angle of its own."""
    filled = corners.copy()
    for column in range(3):  # such a corner takes the angle of the next one
        filled[:, column] = np.where(on_axis[:, column], corners[:, (column + 1) % 3], filled[:, column])
    base = filled[:, :1]
    turned = (filled - base + pi) % tau - pi
    return base[:, 0] + turned.min(axis=1), base[:, 0] + turned.max(axis=1)


def groups_of_one(features: Array, near: float, are_one: Callable[[int, int], bool]) -> list[list[int]]:
    """Return groups of pieces that are linked, directly or through others, by pairs that belong together.

    `features`, shape (n, k), differ by less than `near` between two pieces that belong together; `are_one` is called
    with two indices only then. Indices ascend in each group; the groups are ordered by their first index.
    """
    group_of = np.arange(len(features))
    for place in range(len(features)):
        close = (np.abs(features[:place] - features[place]) < near).all(axis=1)
        for other in np.flatnonzero(close).tolist():
            if group_of[other] != group_of[place] and are_one(other, place):
                joined = group_of[other], group_of[place]
                group_of[np.isin(group_of, joined)] = min(joined)
    return [np.flatnonzero(group_of == group).tolist() for group in np.unique(group_of)]


# -- arcs -------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, kw_only=True)
class ArcPiece:
    """An edge as given in the file, in the frame of its product; lengths in mm, angles in rad."""

    place: int
    """Index among all edges of the product."""
    faces: tuple[int, ...]
    centre: Array
    axis: Array
    radius: float
    recognition_gap: float
    points: Array
    """Points from one end to the other, shape (n, 3), each less than half a turn from the next."""


def merge_arcs(pieces: list[ArcPiece], part: str) -> list[CadEdge]:
    """Return the circles and arcs of a part."""
    near = _NEAR + 2 * max((piece.recognition_gap for piece in pieces), default=0.0)
    features = np.array([(*piece.centre, piece.radius) for piece in pieces]).reshape(-1, 4)
    groups = groups_of_one(features, near, lambda a, b: _is_one_circle(pieces[a], pieces[b]))
    return [_edge([pieces[place] for place in group], part) for group in groups]


def _is_one_circle(a: ArcPiece, b: ArcPiece) -> bool:
    """Return whether two arcs lie on one circle."""
    allowed = _SAME + a.recognition_gap + b.recognition_gap
    tilt = float(np.linalg.norm(np.cross(a.axis, b.axis)))
    apart = float(np.linalg.norm(a.centre - b.centre)), abs(a.radius - b.radius), tilt * a.radius
    return max(apart) <= allowed


def _edge(pieces: list[ArcPiece], part: str) -> CadEdge:
    first = pieces[0]
    frame = perpendicular(first.axis)
    starts, ends = [], []
    for piece in pieces:
        away = piece.points - first.centre
        angles = np.unwrap(np.arctan2(away @ frame[1], away @ frame[0]))
        starts.append(angles.min())
        ends.append(angles.max())
    span, middle = covered(np.array(starts), np.array(ends))
    towards = np.cos(middle) * frame[0] + np.sin(middle) * frame[1] if span < tau - 1e-6 else np.zeros(3)
    return CadEdge(
        part=part,
        faces=tuple(sorted({number for piece in pieces for number in piece.faces})),
        centre=first.centre,
        axis=first.axis,
        radius=first.radius,
        span=span,
        middle=towards,
        recognition_gap=max(piece.recognition_gap for piece in pieces),
        places=tuple(piece.place for piece in pieces),
    )
