"""Profiles divided at their hollow corners: a ball or a round edge in a notch touches two faces, or two edges, at once.

The gap to a whole profile is that of one nearest point, which would jump from face to face in a notch. The solids on
both sides of a cut from the corner into the material are each convex there: the gap to each has one nearest point, and
the ball is held by both. Outside the material nothing else changes: a cut opens no face to the outside.
"""

import cmath
from dataclasses import replace

from engine.mechanism.closed_profiles import CLOSE, Piece, crossings

SHARP = 0.05  # angle [rad] by which two faces must meet hollow to count as two; less is a curve in facets
Curve = tuple[Piece, ...]


def divided(curve: Curve) -> list[Curve]:
    """Return the closed curves into which the hollow corners of a closed one divide it; itself if it has none."""
    for i, (piece, after) in enumerate(zip(curve, (*curve[1:], curve[0]), strict=True)):
        turn = -cmath.phase(piece.direction(1.0).conjugate() * after.direction(0.0))
        if turn > SHARP and (parts := _cut((*curve[i + 1 :], *curve[: i + 1]))):
            return [each for part in parts for each in divided(part)]
    return [curve]


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
