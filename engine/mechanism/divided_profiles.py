"""Profiles divided at their hollow corners, in which a ball or a round edge touches two faces at once.

The gap to a whole profile is that of one nearest point, which would jump from face to face in a notch. The solids on
both sides of a cut from the corner into the material are each convex there: the gap to each has one nearest point, and
the ball is held by both. Outside the material nothing else changes: a cut opens no face to the outside.
"""

import cmath
import math
from dataclasses import replace

from engine.mechanism.closed_profiles import CLOSE, Piece, crossings

SHARP = 0.05  # angle [rad] by which two faces must meet hollow to hold a round on both sides
Curve = tuple[Piece, ...]


def divided(curve: Curve, radius: float, reach: float = math.tau) -> list[Curve]:
    """Return the closed curves into which a profile is divided where a round touches two faces; itself if nowhere.

    The round has a radius, in the lengths of the curve, and spans the angle ``reach`` [rad].
    """
    for i, (piece, after) in enumerate(zip(curve, (*curve[1:], curve[0]), strict=True)):
        turn = -cmath.phase(piece.direction(1.0).conjugate() * after.direction(0.0))
        fits = SHARP < turn <= reach and all(_holds(face, radius, turn) for face in (piece, after))
        if fits and (parts := _cut((*curve[i + 1 :], *curve[: i + 1]))):
            return [each for part in parts for each in divided(part, radius, reach)]
    return [curve]


def _holds(face: Piece, radius: float, turn: float) -> bool:
    """Return whether a round in a hollow corner, where two faces meet at an angle, can touch one within its length."""
    if face.centre is None:
        return radius * math.tan(0.5 * turn) < abs(face.end - face.start)
    return face.left or radius < face.radius


def _cut(curve: Curve) -> tuple[Curve, ...]:
    """Return the two parts of a curve that begins at a hollow corner, cut from there to the nearest piece across it.

    There are none if the corner is so thin a needle that rounding hides what lies across it.
    """
    corner, one, other = curve[0].start, curve[-1].direction(1.0), curve[0].direction(0.0)
    way = 1j * (one + other)  # into the material, between the two faces
    size = max(abs(piece.end - corner) for piece in curve)
    ray, close = Piece(corner, corner + 2.0 * size * way / abs(way)), CLOSE * size
    hits = [
        (abs(at - corner), i, at)
        for i, piece in enumerate(curve)
        for at in crossings(ray, piece, close)
        if abs(at - corner) > close and ray.has(at, close) and piece.has(at, close)
    ]
    if not hits:
        return ()
    _, i, at = min(hits, key=lambda hit: hit[:2])
    piece, first, second = curve[i], curve[:i], curve[i + 1 :]
    if abs(at - piece.start) <= close:
        at, second = piece.start, (piece, *second)
    elif abs(at - piece.end) <= close:
        at, first = piece.end, (*first, piece)
    else:
        first, second = (*first, replace(piece, end=at)), (replace(piece, start=at), *second)
    return (*first, Piece(at, corner)), (Piece(corner, at), *second)
