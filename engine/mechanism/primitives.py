"""Contact primitives: simple shapes fixed to a body, whose distances have a closed form or one angle to search for.

Lengths and directions are in the frame of the body. A face is the top of a plate: a body that slides over its edge
meets the side of the plate, and one that has come more than half its depth behind it is let out at the back.
"""

import math
from typing import Annotated, Any, Self

from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from engine.mechanism.base import (
    Direction,
    Number,
    Point,
    PositiveLength,
    PositiveNumber,
    TableModel,
    check_perpendicular,
    is_number,
    refuse,
)
from engine.mechanism.components import Each
from engine.mechanism.quantities import Quantity

_TWO_SIZES = {"type": "array", "items": {"type": "number", "exclusiveMinimum": 0}, "minItems": 2, "maxItems": 2}


def _two_sizes(value: Any) -> tuple[float, float]:
    """Read the two half sides of a rectangle."""
    if not isinstance(value, list | tuple) or len(value) != 2 or not all(is_number(v) and v > 0 for v in value):
        raise refuse("not two half sides; allowed: two finite numbers > 0; write half the length and half the width")
    return (float(value[0]), float(value[1]))


class Sphere(TableModel):
    """The outside of a sphere."""

    centre: Point = Field(description="the centre of the sphere, in the body frame")
    radius: PositiveLength = Field(description="the radius of the sphere, a number > 0")


class Socket(TableModel):
    """The inside of a sphere."""

    centre: Point = Field(description="the centre of the hollow sphere, in the body frame")
    radius: PositiveLength = Field(description="the radius of the hollow sphere, a number > 0")


class Arc(TableModel):
    """A circular arc or a full circle; with an edge radius it is a rounded edge, a piece of a torus."""

    centre: Point = Field(description="the centre of the circle, in the body frame")
    normal: Direction = Field(description="the normal of the circle's plane")
    middle: Direction | None = Field(
        default=None, description="the direction from the centre to the middle of the arc; a full circle needs none"
    )
    radius: PositiveLength = Field(description="the radius of the arc, a number > 0")
    half_angle: Annotated[PositiveNumber, Field(le=3.1415926535897936), Quantity("angle")] = Field(
        default=math.pi, description="half the angle the arc spans, in rad; pi for a full circle"
    )
    edge_radius: Annotated[Number, Field(ge=0), Quantity("length")] = Field(
        default=0.0, description="the radius of the edge's rounding, whose centres lie on the arc, a number >= 0"
    )

    @model_validator(mode="after")
    def _in_plane(self) -> Self:
        if self.middle is not None:
            check_perpendicular(self.normal, self.middle, ("normal", "middle"))
        elif self.half_angle < math.pi:
            raise refuse("missing; an arc needs the direction to its middle; add it, or drop half_angle", key="middle")
        return self


class Ring(TableModel):
    """The ring of a bore around a cylinder, or a ring on a pin inside a bore; its tilt is neglected."""

    centre: Point = Field(description="the centre of the ring, in the body frame")
    radius: PositiveLength = Field(description="the radius of the ring where it touches, a number > 0")


class Cylinder(TableModel):
    """The outside of a cylinder; ``point`` is at mid-height of the working patch."""

    point: Point = Field(description="the point of the axis at mid-height of the working patch")
    axis: Direction = Field(description="the direction of the cylinder's axis")
    radius: PositiveLength = Field(description="the radius of the cylinder, a number > 0")
    half_length: Annotated[PositiveLength | None, Quantity("length")] = Field(
        default=None, description="half the length between the flat ends, a number > 0; default: without ends"
    )


class Bore(TableModel):
    """The inside of a cylinder; with ends it is a hole through a plate."""

    point: Point = Field(description="the point of the axis at mid-height of the working patch")
    axis: Direction = Field(description="the direction of the bore's axis")
    radius: PositiveLength = Field(description="the radius of the bore, a number > 0")
    half_length: Annotated[PositiveLength | None, Quantity("length")] = Field(
        default=None, description="half the length of the hole, a number > 0; default: without ends"
    )


class Plane(TableModel):
    """A plane; its normal points to the free side."""

    point: Point = Field(description="a point of the plane, in the body frame")
    normal: Direction = Field(description="the normal of the plane, pointing to the free side")


class Disc(TableModel):
    """A round face: the top of a round plate."""

    centre: Point = Field(description="the centre of the face, in the body frame")
    normal: Direction = Field(description="the normal of the face, pointing to the free side")
    radius: PositiveLength = Field(description="the radius of the face, a number > 0")
    depth: Annotated[PositiveLength | None, Quantity("length")] = Field(
        default=None, description="the thickness of the plate behind the face, a number > 0; default: the radius"
    )


class Rectangle(TableModel):
    """A rectangular face: the top of a rectangular plate."""

    centre: Point = Field(description="the centre of the face, in the body frame")
    normal: Direction = Field(description="the normal of the face, pointing to the free side")
    along: Direction = Field(description="the direction of the face's first side")
    half_lengths: Annotated[
        tuple[float, float], BeforeValidator(_two_sizes), WithJsonSchema(_TWO_SIZES), Quantity("length"), Each(gt=0.0)
    ] = Field(description="half the sides of the face, along `along` and across it, two numbers > 0")
    depth: Annotated[PositiveLength | None, Quantity("length")] = Field(
        default=None,
        description="the thickness of the plate behind the face, a number > 0; default: the smaller half side",
    )

    @model_validator(mode="after")
    def _in_plane(self) -> Self:
        check_perpendicular(self.normal, self.along, ("normal", "along"))
        return self
