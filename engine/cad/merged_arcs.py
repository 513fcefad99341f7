"""Merge arcs of one circle into one edge, such as the circle at the end of a bore that was cut into halves."""

from dataclasses import dataclass
from math import tau

import numpy as np

from engine.arrays import Array
from engine.cad.angles import covered, perpendicular
from engine.cad.cad_model import CadEdge
from engine.cad.one_surface import groups_of_one

_NEAR = 1e-2  # mm between the features of two arcs that may be merged
_SAME = 1e-6  # mm between two circles that are one, besides their recognition gaps


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
    groups = groups_of_one(features, near, lambda a, b: _are_one(pieces[a], pieces[b]))
    return [_edge([pieces[place] for place in group], part) for group in groups]


def _are_one(a: ArcPiece, b: ArcPiece) -> bool:
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
