"""Unilateral contacts between two named primitives, whose gap has a closed form."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from engine.mechanism.base import (
    Direction,
    Friction,
    Length,
    Model,
    Name,
    Number,
    Point,
    PositiveLength,
    Restitution,
    refuse,
)
from engine.mechanism.quantities import Quantity

ContactKind = Literal["point-plane", "arc-plane", "cylinder-plane", "arc-cylinder"]
PAIRS: tuple[ContactKind, ...] = ("point-plane", "arc-plane", "cylinder-plane", "arc-cylinder")


class Plane(Model):
    """A plane; its normal points to the free side."""

    point: Point = Field(description="a point of the plane, in the body frame")
    normal: Direction = Field(description="the normal of the plane, pointing to the free side")


class Arc(Model):
    """A circular arc, or a full circle."""

    centre: Point = Field(description="the centre of the circle, in the body frame")
    normal: Direction = Field(description="the normal of the circle's plane")
    middle: Direction = Field(description="the direction from the centre to the middle of the arc")
    radius: PositiveLength = Field(description="the radius of the arc, a number > 0")
    half_angle: Annotated[Number, Field(gt=0, le=3.1415926535897936), Quantity("angle")] = Field(
        description="half the angle the arc spans, in rad; pi for a full circle"
    )

    @model_validator(mode="after")
    def _in_plane(self) -> Self:
        lean = sum(n * m for n, m in zip(self.normal, self.middle, strict=True))
        if abs(lean) > 1e-5:
            raise refuse(
                f"out of the arc's plane (normal . middle = {lean:.2g}); allowed: perpendicular to normal; "
                "correct one of the two",
                key="middle",
                value=list(self.middle),
            )
        return self


class Cylinder(Model):
    """The outside of a cylinder; ``point`` is at mid-height of the working patch."""

    point: Point = Field(description="the point of the axis at mid-height of the working patch")
    axis: Direction = Field(description="the direction of the cylinder's axis")
    radius: PositiveLength = Field(description="the radius of the cylinder, a number > 0")


class Side(Model):
    """One side of a contact: a body, and exactly one primitive fixed to it."""

    body: Name = Field(description="the body the primitive belongs to")
    point: Annotated[Point | None, Quantity("length")] = Field(default=None, description="a point: [x, y, z]")
    plane: Plane | None = Field(default=None, description="a plane: { point, normal }")
    arc: Arc | None = Field(default=None, description="an arc: { centre, normal, middle, ... }")
    cylinder: Cylinder | None = Field(default=None, description="a cylinder: { point, axis, radius }")

    @property
    def kind(self) -> str:
        """The primitive's kind: ``"point"``, ``"plane"``, ``"arc"`` or ``"cylinder"``."""
        return next(kind for kind in ("point", "plane", "arc", "cylinder") if getattr(self, kind) is not None)

    @model_validator(mode="after")
    def _one_primitive(self) -> Self:
        given = [kind for kind in ("point", "plane", "arc", "cylinder") if getattr(self, kind) is not None]
        if len(given) != 1:
            raise refuse(
                f"has {' and '.join(given) or 'no primitive'}; "
                "allowed: exactly one of point, plane, arc, cylinder; keep one"
            )
        return self


class Contact(Model):
    """A unilateral contact with friction between two primitives; the order of a and b does not matter."""

    a: Side = Field(description="one side: { body, and a point, plane, arc or cylinder }")
    b: Side = Field(description="the other side: { body, and a point, plane, arc or cylinder }")
    offset: Length = Field(default=0.0, description="a skin subtracted from the gap")
    material: Name | None = Field(default=None, description="the pair of materials, a table of [materials]")
    friction: Annotated[Friction | None, Quantity("number")] = Field(
        default=None, description="the coefficient of friction, instead of the material's"
    )
    restitution: Annotated[Restitution | None, Quantity("number")] = Field(
        default=None, description="the coefficient of restitution, instead of the material's"
    )

    @property
    def kind(self) -> ContactKind:
        """The pair of primitives, in the order of ``sides``: ``"point-plane"``, ``"arc-plane"``, ..."""
        kinds = {self.a.kind, self.b.kind}
        return next(pair for pair in PAIRS if set(pair.split("-")) == kinds)

    @property
    def sides(self) -> tuple[Side, Side]:
        """The two sides in the order ``kind`` names them, such as (arc, plane)."""
        return (self.a, self.b) if self.a.kind == self.kind.split("-")[0] else (self.b, self.a)

    @model_validator(mode="after")
    def _supported(self) -> Self:
        if {self.a.kind, self.b.kind} not in [set(pair.split("-")) for pair in PAIRS]:
            raise refuse(
                f"{self.a.kind} against {self.b.kind} has no gap function; "
                f"allowed pairs: {', '.join(PAIRS)}; "
                "replace one side by points or arcs of its outline"
            )
        if self.material is None and self.friction is None:
            raise refuse("missing; name a pair of [materials], or give friction", key="material")
        return self
