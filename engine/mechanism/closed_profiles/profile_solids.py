"""Contact primitives made from a profile of lines and arcs: turned about an axis, or extruded along it."""

from functools import cached_property
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from engine.mechanism.base import Direction, Point, PositiveLength, TableModel, check_perpendicular, is_number, refuse
from engine.mechanism.closed_profiles.profile_curve import BACKWARDS, CLOSE, MOST_SEGMENTS, Piece, closed_curve
from engine.mechanism.quantities import Quantity

_TWO_NUMBERS = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}


def _two_numbers(value: Any) -> tuple[float, float]:
    """Read a point of the profile's plane."""
    if not isinstance(value, list | tuple) or len(value) != 2 or not all(map(is_number, value)):
        raise refuse("not a point of a profile; allowed: two finite numbers; write both")
    return (float(value[0]), float(value[1]))


PlanePoint = Annotated[
    tuple[float, float], BeforeValidator(_two_numbers), WithJsonSchema(_TWO_NUMBERS), Quantity("length")
]


class ProfileSegment(TableModel):
    """A line or an arc of a profile; it starts at the end of the previous segment."""

    to: PlanePoint = Field(description="the end of the segment, in the plane of the profile")
    centre: PlanePoint | None = Field(default=None, description="the centre of an arc; without it, a line")
    turn: Literal["left", "right"] | None = Field(
        default=None, description="the way in which an arc turns: left (counterclockwise) or right"
    )

    @model_validator(mode="after")
    def _line_or_arc(self) -> Self:
        if (self.centre is None) != (self.turn is None):
            missing = "turn" if self.turn is None else "centre"
            raise refuse(
                "missing; an arc has a centre, and turns left or right; add it, or write a line: to alone", key=missing
            )
        return self


Segments = Annotated[tuple[ProfileSegment, ...], Field(json_schema_extra={"minItems": 1, "maxItems": MOST_SEGMENTS})]


class Turned(TableModel):
    """A solid turned from a profile [r, z]: distance from the axis, height along it."""

    point: Point = Field(description="the point of the axis at the height 0 of the profile")
    axis: Direction = Field(description="the direction of the axis, in which the profile's height grows")
    start: PlanePoint = Field(description="where the profile begins: [r, z]")
    profile: Segments = Field(description="lines and arcs to points [r, z]; from the last a line leads to the start")

    @cached_property
    def curve(self) -> tuple[Piece, ...]:
        """The pieces of the profile that are surfaces of the solid, not on its axis; material on their left."""
        return tuple(piece for piece in self._closed if piece.centre is not None or piece.start.real or piece.end.real)

    @cached_property
    def _closed(self) -> list[Piece]:
        return closed_curve(complex(*self.start), self.profile, on_axis=True)

    @model_validator(mode="after")
    def _beside_the_axis(self) -> Self:
        size = max(abs(p - q) for q in self._closed[0].extremes() for piece in self._closed for p in piece.extremes())
        least = min((p.real, p.imag) for piece in self._closed for p in piece.extremes())
        if least[0] < -CLOSE * size:
            raise refuse(
                f"reaches the other side of the axis at [{least[0]:.6g}, {least[1]:.6g}]; allowed: r >= 0; "
                "draw one half of the section",
                key="profile",
            )
        for piece in self.curve:
            for at, share in ((piece.start, 0.0), (piece.end, 1.0)):
                if not at.real and abs(piece.direction(share).real) < BACKWARDS:
                    raise refuse(
                        f"ends on the axis, at z = {at.imag:.6g}, in a needle or a slit without width; allowed: any "
                        "angle to the axis; leave a small flat there",
                        key="profile",
                    )
        return self


class Extruded(TableModel):
    """A solid extruded from a profile [x, y] in the plane perpendicular to an axis: a cam, a hook, a ratchet."""

    point: Point = Field(description="the origin of the profile, at half the length of the solid")
    axis: Direction = Field(description="the direction in which the profile is extruded")
    along: Direction = Field(description="the direction of the profile's x; y is across the axis and x")
    half_length: Annotated[PositiveLength | None, Quantity("length")] = Field(
        default=None, description="half the length between the flat ends, a number > 0; default: without ends"
    )
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
