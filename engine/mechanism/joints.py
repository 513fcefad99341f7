"""Joints with play: a journal that moves inside the rings of a bearing (the paper's section 3.1)."""

from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from engine.mechanism.base import (
    Direction,
    Friction,
    Length,
    Model,
    Name,
    Point,
    PositiveLength,
    Restitution,
    is_number,
    refuse,
)
from engine.mechanism.quantities import Quantity


def _radii(value: Any) -> float | tuple[float, ...]:
    """Read one positive radius, or one for each ring."""
    if is_number(value) and value > 0:
        return float(value)
    if isinstance(value, list | tuple) and value and all(is_number(r) and r > 0 for r in value):
        return tuple(float(r) for r in value)
    raise refuse("not a radius; allowed: a number > 0, or a list with one number > 0 for each ring")


def _stations(value: Any) -> tuple[float, ...]:
    """Read the stations of the rings along the bearing's axis."""
    if not isinstance(value, list | tuple) or not value or not all(map(is_number, value)):
        raise refuse("not a list of ring stations; allowed: one or more finite numbers; two rings carry tilt")
    return tuple(float(s) for s in value)


class Bearing(Model):
    """The bore; the stations of its rings are measured from ``point`` along ``axis``."""

    body: Name = Field(description="the body that has the bore")
    point: Point = Field(description="a point of the bore's axis, in the body frame")
    axis: Direction = Field(description="the direction of the bore's axis, in the body frame")


class Journal(Model):
    """The pin inside the bore."""

    body: Name = Field(description="the body that has the pin")
    point: Point = Field(description="a point of the pin's axis, in the body frame")
    axis: Direction = Field(description="the direction of the pin's axis, in the body frame")
    radius: Annotated[float | tuple[float, ...], BeforeValidator(_radii), Quantity("length")] = Field(
        description="the radius of the pin, a number > 0, or a list with one for each ring"
    )


class ClearanceRevolute(Model):
    """A revolute joint with radial clearance: one frictional unilateral contact at each ring of the bore."""

    type: Literal["clearance_revolute"] = Field(description="the kind of joint")
    bearing: Bearing = Field(description="the bore: { body, point, axis }")
    journal: Journal = Field(description="the pin: { body, point, axis, radius }")
    rings: Annotated[tuple[float, ...], BeforeValidator(_stations), Quantity("length")] = Field(
        description="the stations of the bearing's rings along its axis, one or more numbers"
    )
    radial_clearance: Length = Field(
        description="bore radius minus journal radius, the same at every ring, a number > 0",
        json_schema_extra={"exclusiveMinimum": 0},
    )
    radial_clearance_limit: Annotated[PositiveLength | None, Quantity("length")] = Field(
        default=None,
        description="the largest clearance the bore as drawn allows",
    )
    material: Name | None = Field(
        default=None, description="the pair of materials, a table of [materials]; default: that between the bodies'"
    )
    friction: Annotated[Friction | None, Quantity("number")] = Field(
        default=None, description="the coefficient of friction, instead of the material's"
    )
    restitution: Annotated[Restitution | None, Quantity("number")] = Field(
        default=None, description="the coefficient of restitution, instead of the material's"
    )

    @property
    def sides(self) -> tuple[Bearing, Journal]:
        """The two sides."""
        return self.bearing, self.journal

    @property
    def radii(self) -> tuple[float, ...]:
        """Journal radius at each ring [length], one value per ring."""
        radius = self.journal.radius
        return radius if isinstance(radius, tuple) else (radius,) * len(self.rings)

    @property
    def clearance_limit(self) -> float:
        """The largest radial clearance that may be set [length]."""
        limit = self.radial_clearance_limit
        return min(self.radii) if limit is None else limit

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if len(self.radii) != len(self.rings):
            raise refuse(
                f"{len(self.radii)} radii for {len(self.rings)} rings; "
                "allowed: one number, or one for each ring; give as many",
                key="journal.radius",
                value=list(self.radii),
            )
        if len(set(self.rings)) != len(self.rings):
            raise refuse(
                "two rings at one station; allowed: different stations; remove one",
                key="rings",
                value=list(self.rings),
            )
        if not 0 < self.radial_clearance <= self.clearance_limit:
            what = "no play" if self.radial_clearance <= 0 else "more than the bore as drawn allows"
            raise refuse(
                f"{what}; allowed: 0 < radial_clearance <= {self.clearance_limit:g}; "
                "choose a clearance in between, or give another radial_clearance_limit",
                key="radial_clearance",
                value=self.radial_clearance,
            )
        return self
