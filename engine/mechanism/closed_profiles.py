"""Closed profiles of lines and arcs in a plane, and the primitives turned about an axis, or extruded along it.

Points of a profile are complex numbers u + i v.
"""

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from engine.mechanism.base import (
    Direction,
    OptionalLength,
    Point,
    TableModel,
    check_perpendicular,
    numbers_or,
    optional,
    refuse,
)
from engine.mechanism.quantities import Quantity

MOST_SEGMENTS = 500
CLOSE = 1e-9  # share of the profile's size: points closer together than this coincide
ON_CIRCLE = 1e-4  # share of the smaller of an arc's radius and chord by which its ends may miss its circle
BACKWARDS = 1e-6  # smallest angle [rad] between a corner and a complete reversal
BESIDE_A_CORNER = 1e-5  # share of the profile's size around a corner in which its two pieces are not tested for meeting

_TWO_NUMBERS = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}


@dataclass(frozen=True)
class Piece:
    """A line, or an arc about a centre that turns left or right; an arc that ends where it starts is a full circle."""

    start: complex
    end: complex
    centre: complex | None = None
    left: bool = True

    @property
    def radius(self) -> float:
        """The radius of an arc."""
        return abs(self.start - self.centre) if self.centre is not None else 0.0

    @property
    def sweep(self) -> float:
        """The angle that an arc spans, > 0 [rad]."""
        if self.centre is None:
            return 0.0
        turn = 0.0 if self.end == self.start else self._turn(self.end, self.centre)
        return turn if turn > 0 else turn + 2 * math.pi

    def _turn(self, point: complex, centre: complex) -> float:
        """Return the angle from an arc's start to a point in its sense of rotation, from -pi to pi [rad]."""
        return cmath.phase((point - centre) / (self.start - centre)) * (1 if self.left else -1)

    def point(self, share: Any) -> Any:
        """Return the points at given shares of the length, from 0 at the start to 1 at the end."""
        if self.centre is None:
            return self.start + (self.end - self.start) * share
        turn = self.sweep * (1j if self.left else -1j)
        return self.centre + (self.start - self.centre) * np.exp(turn * share)

    def direction(self, share: float) -> complex:
        """Return the unit tangent at a share of the length, in the direction of travel."""
        if self.centre is None:
            return (self.end - self.start) / abs(self.end - self.start)
        return complex((self.point(share) - self.centre) * (1j if self.left else -1j) / self.radius)

    def reversed(self) -> Self:
        """Return the piece traversed in the opposite direction."""
        return replace(self, start=self.end, end=self.start, left=not self.left)

    def extremes(self) -> list[complex]:
        """Return the ends, and for an arc also its leftmost, rightmost, highest and lowest points."""
        points = [self.start, self.end]
        if self.centre is not None:
            points += [p for way in (1, 1j, -1, -1j) if self.has(p := self.centre + self.radius * way, 0.0)]
        return points

    def has(self, point: complex, close: float) -> bool:
        """Return whether a point lies on the piece or is closer to it than ``close``."""
        if min(abs(point - self.start), abs(point - self.end)) <= close:
            return True
        if self.centre is None:
            along = ((self.end - self.start).conjugate() * (point - self.start)) / abs(self.end - self.start)
            return 0 <= along.real <= abs(self.end - self.start) and abs(along.imag) <= close
        if abs(abs(point - self.centre) - self.radius) > close + 1e-14 * self.radius:
            return False
        return self._turn(point, self.centre) % (2 * math.pi) <= self.sweep

    @property
    def area(self) -> float:
        """Signed area of the sector seen from the origin, positive if the piece runs counterclockwise around it."""
        sector = 0.5 * (self.start.conjugate() * self.end).imag
        cap = 0.5 * self.radius**2 * (self.sweep - math.sin(self.sweep))
        return sector + (cap if self.left else -cap)


def closed_curve(start: complex, segments: Sequence[Any], *, on_axis: bool = False) -> list[Piece]:
    """Return the pieces of a closed profile, with the material on their left side.

    ``on_axis`` moves points that almost lie on the line u = 0 onto it. Raise the error of `refuse` if the ends of an
    arc miss its circle, a segment has no length, turns back or meets another one, or there are no segments or too many.
    """
    if not 0 < len(segments) <= MOST_SEGMENTS:
        text = f"{len(segments)} segments; allowed: 1 to {MOST_SEGMENTS}; write the lines and arcs of a closed curve"
        raise refuse(text, key="profile")
    points = [start, *(complex(*segment.to) for segment in segments)]
    circles = (abs(complex(*segment.centre) - start) for segment in segments if segment.centre)
    size = max(abs(p - start) for p in points) or max(circles, default=0.0)
    if abs(points[-1] - start) <= CLOSE * size:
        points[-1] = start
    if on_axis:
        points = [complex(0.0, p.imag) if abs(p.real) <= CLOSE * size else p for p in points]
    pieces = [_piece(points[i], points[i + 1], segment, i, size) for i, segment in enumerate(segments)]
    names = [f"segment {i}" for i in range(len(segments))]
    if points[-1] != points[0]:
        pieces.append(Piece(points[-1], points[0]))
        names.append("the line that closes the profile")
    _refuse_corners(pieces, names)
    _refuse_meetings(pieces, names, size)
    if sum(piece.area for piece in pieces) < 0:
        return [piece.reversed() for piece in reversed(pieces)]
    return pieces


def _piece(start: complex, end: complex, segment: Any, i: int, size: float) -> Piece:
    """Return a segment as a piece; the centre of an arc is moved to equal distance from both ends."""
    key, chord = f"profile.{i}", end - start
    centre, left = complex(*(segment.centre or segment.to)), segment.turn == "left"
    first, last = abs(start - centre), abs(end - centre)
    if abs(chord) <= CLOSE * size and first <= CLOSE * size:
        text = "ends where it begins; allowed: a line or an arc with a length; correct the point, or remove the "
        raise refuse(f"{text}segment: a profile closes by itself", key=f"{key}.to", value=list(segment.to))
    if segment.centre is None:
        return Piece(start, end)
    if abs(chord) <= CLOSE * size:
        return Piece(start, start, centre, left)
    if not abs(first - last) <= ON_CIRCLE * min(first, abs(chord)):
        text = f"the arc begins {first:.9g} and ends {last:.9g} from its centre; allowed: the same distance; correct "
        raise refuse(f"{text}the centre or one of the ends", key=f"{key}.centre", value=list(segment.centre))
    across, middle = 1j * chord / abs(chord), 0.5 * (start + end)
    return Piece(start, end, middle + across * (across.conjugate() * (centre - middle)).real, left)


def _refuse_corners(pieces: Sequence[Piece], names: Sequence[str]) -> None:
    """Refuse a profile whose curve turns back on itself, or that has other segments besides a full circle."""
    for i, piece in enumerate(pieces):
        if piece.start == piece.end and len(pieces) > 1:
            text = "a full circle; allowed: as the only segment; give it a contact of its own"
            raise refuse(text, key=f"profile.{i}")
        if abs(pieces[i - 1].direction(1.0) + piece.direction(0.0)) < BACKWARDS:
            text = f"{names[i]} turns back along {names[i - 1]}; allowed: any other angle between the two; give the "
            raise refuse(f"{text}tip or the groove there a width", key="profile")


def _refuse_meetings(pieces: Sequence[Piece], names: Sequence[str], size: float) -> None:
    """Refuse a profile in which two pieces touch or cross each other."""
    extremes = [np.array(piece.extremes()) for piece in pieces]
    low = np.array([[p.real.min(), p.imag.min()] for p in extremes]) - CLOSE * size
    high = np.array([[p.real.max(), p.imag.max()] for p in extremes]) + CLOSE * size
    for i, piece in enumerate(pieces):
        near = np.all((low[i] <= high[i + 1 :]) & (low[i + 1 :] <= high[i]), axis=1)
        for j in (i + 1 + np.flatnonzero(near)).tolist():
            shared = [p for p in (piece.end, piece.start) if p in (pieces[j].start, pieces[j].end)]
            other, close = pieces[j], CLOSE * size
            meetings = [p for p in (piece.start, piece.end) if other.has(p, close)]
            meetings += [p for p in (other.start, other.end) if piece.has(p, close)]
            points = crossings(piece, other, close)
            meetings += [p for p in points if piece.has(p, close) and other.has(p, close)]
            for at in meetings:
                if all(abs(at - corner) > BESIDE_A_CORNER * size for corner in shared):
                    text = f"{names[i]} meets {names[j]} at [{at.real:.6g}, {at.imag:.6g}]; allowed: a curve that "
                    raise refuse(f"{text}neither crosses nor touches itself; correct one of the two", key="profile")


def crossings(one: Piece, other: Piece, close: float) -> list[complex]:
    """Return the points where the infinite lines and full circles of two pieces cross or almost touch each other."""
    if one.centre is None and other.centre is None:
        a, b = one.direction(0.0), other.direction(0.0)
        lean = (a.conjugate() * b).imag
        return [one.start + a * ((other.start - one.start).conjugate() * b).imag / lean] if lean else []
    if one.centre is None or other.centre is None:
        line, arc = (one, other) if one.centre is None else (other, one)
        way = line.direction(0.0)
        foot = line.start + way * (way.conjugate() * (arc.centre - line.start)).real  # type: ignore[operator]
        square = arc.radius**2 - abs(foot - arc.centre) ** 2  # type: ignore[operator]
        reach = math.sqrt(max(square, 0.0))
        return [foot + way * sign * reach for sign in (-1, 1)] if square > -2 * close * arc.radius else []
    between = other.centre - one.centre
    if not abs(between):
        return []
    along = 0.5 * (abs(between) + (one.radius**2 - other.radius**2) / abs(between))
    square = one.radius**2 - along**2
    if not square > -2 * close * one.radius:
        return []
    way, reach = between / abs(between), math.sqrt(max(square, 0.0))
    return [one.centre + way * (along + sign * 1j * reach) for sign in (-1, 1)]


# Contact primitives made from a profile of lines and arcs: turned about an axis, or extruded along it.


_two_numbers = numbers_or("not a point of a profile; allowed: two finite numbers; write both", 2)
PlanePoint = Annotated[
    tuple[float, float], BeforeValidator(_two_numbers), WithJsonSchema(_TWO_NUMBERS), Quantity("length")
]


class ProfileSegment(TableModel):
    """A line or an arc of a profile; it starts at the end of the previous segment."""

    to: PlanePoint = Field(description="the end of the segment, in the plane of the profile")
    centre: PlanePoint | None = optional("the centre of an arc; without it, a line")
    turn: Literal["left", "right"] | None = optional("the way in which an arc turns: left (counterclockwise) or right")

    @model_validator(mode="after")
    def _line_or_arc(self) -> Self:
        if (self.centre is None) != (self.turn is None):
            missing = "turn" if self.turn is None else "centre"
            raise refuse(
                "missing; an arc has a centre, and turns left or right; add it, or write a line: to alone", key=missing
            )
        return self


Segments = Annotated[tuple[ProfileSegment, ...], Field(json_schema_extra={"minItems": 1, "maxItems": MOST_SEGMENTS})]


def off_axis(curve: Sequence[Piece]) -> tuple[Piece, ...]:
    """Return the pieces of a curve that do not lie on the axis."""
    return tuple(piece for piece in curve if piece.centre is not None or piece.start.real or piece.end.real)


class Turned(TableModel):
    """A solid turned from a profile [r, z]: distance from the axis, height along it."""

    point: Point = Field(description="the point of the axis at the height 0 of the profile")
    axis: Direction = Field(description="the direction of the axis, in which the profile's height grows")
    start: PlanePoint = Field(description="where the profile begins: [r, z]")
    profile: Segments = Field(description="lines and arcs to points [r, z]; from the last a line leads to the start")

    @cached_property
    def curve(self) -> tuple[Piece, ...]:
        """The pieces of the profile that are surfaces of the solid, not on its axis; material on their left."""
        return off_axis(self.closed)

    @cached_property
    def closed(self) -> tuple[Piece, ...]:
        """All pieces of the profile, with those on the axis."""
        return tuple(closed_curve(complex(*self.start), self.profile, on_axis=True))

    @model_validator(mode="after")
    def _beside_the_axis(self) -> Self:
        size = max(abs(p - q) for q in self.closed[0].extremes() for piece in self.closed for p in piece.extremes())
        least = min((p.real, p.imag) for piece in self.closed for p in piece.extremes())
        if least[0] < -CLOSE * size:
            text = f"reaches the other side of the axis at [{least[0]:.6g}, {least[1]:.6g}]; allowed: r >= 0; draw one "
            raise refuse(f"{text}half of the section", key="profile")
        for piece in self.curve:
            for at, share in ((piece.start, 0.0), (piece.end, 1.0)):
                if not at.real and abs(piece.direction(share).real) < BACKWARDS:
                    text = f"ends on the axis, at z = {at.imag:.6g}, in a needle or a slit without width; allowed: any "
                    raise refuse(f"{text}angle to the axis; leave a small flat there", key="profile")
        return self


class Extruded(TableModel):
    """A solid extruded from a profile [x, y] in the plane perpendicular to an axis: a cam, a hook, a ratchet."""

    point: Point = Field(description="the origin of the profile, at half the length of the solid")
    axis: Direction = Field(description="the direction in which the profile is extruded")
    along: Direction = Field(description="the direction of the profile's x; y is across the axis and x")
    half_length: OptionalLength = optional("half the length between the flat ends, a number > 0; default: without ends")
    start: PlanePoint = Field(description="where the profile begins: [x, y]")
    profile: Segments = Field(description="lines and arcs to points [x, y]; from the last a line leads to the start")

    @cached_property
    def curve(self) -> tuple[Piece, ...]:
        """The pieces of the profile, with the material on their left side."""
        return tuple(closed_curve(complex(*self.start), self.profile))

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        check_perpendicular(self.axis, self.along, ("axis", "along"))
        if not sum(piece.area for piece in self.curve) > 0:
            raise refuse("encloses nothing; allowed: a curve around an area; correct its points", key="profile")
        return self
