"""Profiles as rows of `engine.kernels.contact_geometry.profiles`, one per line or arc."""

import math

import numpy as np

from engine.arrays import Array
from engine.kernels.model import PIECE
from engine.mechanism.closed_profiles.profile_curve import Piece
from engine.mechanism.contacts import Side

NO_PIECES = np.zeros((0, PIECE))
SMOOTH = 1e-9  # sine of the angle at a joint; a smaller one is no corner


def profile_pieces(side: Side) -> Array:
    """Return the pieces of a side's profile, shape (np, PIECE); empty if it has no profile."""
    if side.kind not in ("turned", "extruded"):
        return NO_PIECES
    curve = side.primitive.curve
    return np.array([_row(piece, curve[i - 1], curve[(i + 1) % len(curve)]) for i, piece in enumerate(curve)])


def _row(piece: Piece, before: Piece, after: Piece) -> list[float]:
    """Return the row of a piece; where it ends on the axis of a turned solid, its mirror image is its neighbour."""
    middle, reach, place, way = 0.5 * (piece.start + piece.end), 0.5 * abs(piece.end - piece.start), 0j, 0j
    radius = piece.radius if piece.left else -piece.radius
    if piece.centre is None:
        place = piece.direction(0.0)
    else:
        place, way = piece.centre, complex(piece.point(0.5) - piece.centre) / piece.radius
        if piece.sweep > math.pi:
            middle, reach = piece.centre, piece.radius
    one, other = piece.direction(0.0), piece.direction(1.0)
    start, bend = _corner(before.direction(1.0) if before.end == piece.start else one.conjugate(), one)
    end, bow = _corner(other, after.direction(0.0) if after.start == piece.end else other.conjugate())
    numbers = (piece.start, piece.end, middle, reach, radius, place, way, math.tan(piece.sweep / 4), start, end)
    flat = [x for number in numbers for x in ((number.real, number.imag) if isinstance(number, complex) else (number,))]
    return [*flat, bend, bow]


def _corner(before: complex, after: complex) -> tuple[complex, float]:
    """Return the direction bisecting the normals of two pieces, and 1 for a convex corner, -1, or 0 if smooth."""
    halfway, bend = -1j * (before + after), (before.conjugate() * after).imag
    return halfway / abs(halfway), 0.0 if abs(bend) <= SMOOTH else math.copysign(1.0, bend)
