"""Merge pieces of one surface into one face, and arcs of one circle into one edge.

Many CAD systems cut a bore and the circle at its end into halves, or a plane where parts touch.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import pi, tau
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from engine.arrays import Array, Integers
from engine.cad.cad_model import CadEdge, CadFace, FaceKind
from engine.cad.geometry import covered, perpendicular

_CORNER = 1e-5  # mm between two corners that coincide
_NEAR = 1e-2  # mm between the features of two pieces or arcs that may be merged
_SAME = 1e-6  # mm between two surfaces or circles that are one, besides their recognition gaps


@dataclass(frozen=True, eq=False)
class FacePiece:
    """A face as given in the file, in the frame of its product, and its triangles; lengths in mm."""

    face: CadFace  # its point is any point of an axis; hollow, span and extent are not known yet
    vertices: Array  # shape (n, 3)
    triangles: Integers  # row indices into `vertices`, shape (m, 3)


def merge_pieces(pieces: list[FacePiece]) -> tuple[list[CadFace], Integers]:
    """Return the faces of a product, and for each piece the number of its face."""
    near = _NEAR + 2 * max((piece.face.recognition_gap for piece in pieces), default=0.0)
    features = np.array([_features(piece.face) for piece in pieces]).reshape(-1, 6)
    groups = groups_of_one(features, near, lambda a, b: _is_one_surface(pieces[a], pieces[b]))
    numbers = np.zeros(len(pieces), np.int64)
    for number, group in enumerate(groups):
        numbers[group] = number
    return [_face([pieces[i] for i in group], number) for number, group in enumerate(groups)], numbers


def _features(face: CadFace) -> Array:
    """Return numbers that are equal for two pieces of one surface: its kind, size and position [mm]."""
    foot = face.point - (face.point @ face.axis) * face.axis  # the point of the axis nearest to the origin
    where = {
        "plane": (*face.axis, face.point @ face.axis),
        "cylinder": (*foot, face.radius),
        "cone": (*foot, face.half_angle),
    }
    kind = get_args(FaceKind).index(face.kind)
    return np.array([face.solid, kind, *where.get(face.kind, (*face.point, face.radius))])


def _is_one_surface(one: FacePiece, other: FacePiece) -> bool:
    """Return whether two pieces lie on the same side of the same surface, and meet along its axis."""
    a, b = one.face, other.face
    if (a.solid, a.kind) != (b.solid, b.kind) or a.kind == "surface":
        return False
    allowed = _SAME + a.recognition_gap + b.recognition_gap
    size = max(np.ptp(one.vertices, axis=0).max(), np.ptp(other.vertices, axis=0).max())
    # as a distance, like the other differences: by how much the axes part over the length of the pieces
    tilt = float(np.linalg.norm(np.cross(a.axis, b.axis))) * size
    between = b.point - a.point
    if a.kind == "plane":
        level = tilt <= allowed and a.axis @ b.axis > 0 and abs(between @ a.axis) <= allowed
        return bool(level) and _share_corners(one, other)
    along = between @ a.axis if a.kind in ("cylinder", "cone") else 0.0
    # the radius at the same height, which varies only on a cone
    radius = b.radius + float((a.point - b.point) @ b.axis) * float(np.tan(b.half_angle))
    sizes = abs(a.radius - radius), abs(a.minor_radius - b.minor_radius), abs(a.half_angle - b.half_angle) * size
    apart = max(*sizes, tilt, float(np.linalg.norm(between - along * a.axis)))
    if apart > allowed or _hollow(a) != _hollow(b) or (a.kind == "cone" and a.axis @ b.axis < 0):
        return False
    if a.kind in ("sphere", "torus"):
        return True
    first, second = (one.vertices - a.point) @ a.axis, (other.vertices - a.point) @ a.axis
    return bool(first.min() <= second.max() + allowed and second.min() <= first.max() + allowed)


def _share_corners(a: FacePiece, b: FacePiece) -> bool:
    """Return whether two pieces share at least two corners of triangles, and so an edge."""
    first, second = ({tuple(corner) for corner in (piece.vertices / _CORNER).round().tolist()} for piece in (a, b))
    return len(first & second) > 1


def _hollow(face: CadFace) -> bool:
    """Return whether the outward normal points to the axis, the centre or the middle of the tube."""
    away = face.on - face.point
    if face.kind != "sphere":
        away = away - (away @ face.axis) * face.axis
    if face.kind == "torus":
        away = face.on - face.point - face.radius * away / np.linalg.norm(away)
    return face.kind not in ("plane", "surface") and bool(away @ face.normal < 0)


def _face(pieces: list[FacePiece], number: int) -> CadFace:
    """Return the face made up of pieces; it has no splines if one of them has none."""
    faces = [piece.face for piece in pieces]
    first = max(faces, key=lambda face: face.area)
    face = replace(
        first,
        number=number,
        hollow=_hollow(first),
        area=sum(each.area for each in faces),
        recognition_gap=max(each.recognition_gap for each in faces),
        splines=sum((each.splines for each in faces), ()) if all(each.splines for each in faces) else (),
    )
    return face if first.kind in ("plane", "surface") else _with_extent(face, pieces)


def _with_extent(face: CadFace, pieces: list[FacePiece]) -> CadFace:
    """Return a face with the angle and the axial length covered by the triangles of its pieces."""
    axis = face.axis if face.kind != "sphere" else np.array([0.0, 0.0, 1.0])
    frame = perpendicular(axis)
    local = [piece.vertices - face.point for piece in pieces]
    corners = np.concatenate(
        [np.arctan2(each @ frame[1], each @ frame[0])[p.triangles] for each, p in zip(local, pieces, strict=True)]
    )
    away = np.concatenate(
        [np.hypot(each @ frame[1], each @ frame[0])[p.triangles] for each, p in zip(local, pieces, strict=True)]
    )
    span, middle = covered(*_intervals(corners, away < 1e-9 * (1.0 + face.radius)))
    heights = np.concatenate([each @ axis for each in local])
    low, high = float(heights.min()), float(heights.max())
    face = replace(face, span=span, middle=_towards(frame, span, middle), extent=np.array([low, high]))
    if face.kind not in ("cylinder", "cone"):
        return face
    half, centre = (high - low) / 2, (high + low) / 2
    point, radius = face.point + centre * axis, face.radius + centre * float(np.tan(face.half_angle))
    return replace(face, point=point, radius=radius, extent=np.array([-half, half]))


def _towards(frame: Array, span: float, middle: float) -> Array:
    """Return the unit vector at an angle in a frame; zeros for a full turn."""
    return np.cos(middle) * frame[0] + np.sin(middle) * frame[1] if span < tau - 1e-6 else np.zeros(3)


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


@dataclass(frozen=True, eq=False)
class ArcPiece:
    """An edge as given in the file, in the frame of its product; lengths in mm."""

    edge: CadEdge  # its span is not known yet
    points: Array  # from one end to the other, shape (n, 3), each less than half a turn from the next


def merge_arcs(pieces: list[ArcPiece]) -> list[CadEdge]:
    """Return the circles and arcs of a product."""
    edges = [piece.edge for piece in pieces]
    near = _NEAR + 2 * max((edge.recognition_gap for edge in edges), default=0.0)
    features = np.array([(*edge.centre, edge.radius) for edge in edges]).reshape(-1, 4)
    groups = groups_of_one(features, near, lambda a, b: _is_one_circle(edges[a], edges[b]))
    return [_edge([pieces[place] for place in group]) for group in groups]


def _is_one_circle(a: CadEdge, b: CadEdge) -> bool:
    """Return whether two arcs lie on one circle."""
    allowed = _SAME + a.recognition_gap + b.recognition_gap
    tilt = float(np.linalg.norm(np.cross(a.axis, b.axis)))
    apart = float(np.linalg.norm(a.centre - b.centre)), abs(a.radius - b.radius), tilt * a.radius
    return max(apart) <= allowed


def _edge(pieces: list[ArcPiece]) -> CadEdge:
    """Return the circle or arc made up of pieces."""
    edges = [piece.edge for piece in pieces]
    frame = perpendicular(edges[0].axis)
    away = [piece.points - edges[0].centre for piece in pieces]
    angles = [np.unwrap(np.arctan2(each @ frame[1], each @ frame[0])) for each in away]
    span, middle = covered(np.array([each.min() for each in angles]), np.array([each.max() for each in angles]))
    return replace(
        edges[0],
        faces=tuple(sorted({number for edge in edges for number in edge.faces})),
        span=span,
        middle=_towards(frame, span, middle),
        recognition_gap=max(edge.recognition_gap for edge in edges),
        places=tuple(place for edge in edges for place in edge.places),
    )
