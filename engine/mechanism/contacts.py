"""Unilateral contacts between two named primitives."""

from functools import cached_property
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from engine.mechanism.base import (
    Length,
    Name,
    Number,
    PairLaw,
    Point,
    PositiveNumber,
    TableModel,
    check_spring,
    not_given,
    refuse,
)
from engine.mechanism.closed_profiles import Extruded, Turned
from engine.mechanism.primitives import Arc, Bore, Cylinder, Disc, Plane, Rectangle, Ring, Socket, Sphere
from engine.mechanism.quantities import Quantity
from engine.mechanism.surfaces.surface import FreeFormSurface

PRIMITIVES = (
    *("point", "sphere", "arc", "ring", "cylinder", "bore", "socket", "plane", "disc", "rectangle"),
    *("turned", "extruded", "surface"),
)

SOLIDS = ("cylinder", "bore", "sphere", "socket", "turned", "extruded", "surface")
FLATS = ("plane", "disc", "rectangle")
_PARTNERS = {
    "point": (*FLATS, *SOLIDS),
    "sphere": (*FLATS, *SOLIDS),
    "arc": (*FLATS, *SOLIDS),
    "cylinder": FLATS,
    "ring": ("cylinder", "bore"),
}
PAIRS = tuple(f"{first}-{second}" for first, seconds in _PARTNERS.items() for second in seconds)
"""The pairs with a gap function: side a of the kernels, then side b."""


class Side(TableModel):
    """One side of a contact: a body, and exactly one primitive fixed to it."""

    body: Name = Field(description="the body the primitive belongs to")
    point: Annotated[Point | None, Quantity("length")] = Field(default=None, description="a point: [x, y, z]")
    sphere: Sphere | None = Field(default=None, description="a sphere: { centre, radius }")
    arc: Arc | None = Field(default=None, description="an arc, circle or rounded edge: { centre, normal, radius, ... }")
    ring: Ring | None = Field(default=None, description="a ring: { centre, radius }")
    cylinder: Cylinder | None = Field(default=None, description="a cylinder: { point, axis, radius, ... }")
    bore: Bore | None = Field(default=None, description="the inside of a cylinder: { point, axis, radius, ... }")
    socket: Socket | None = Field(default=None, description="the inside of a sphere: { centre, radius }")
    plane: Plane | None = Field(default=None, description="a plane: { point, normal }")
    disc: Disc | None = Field(default=None, description="a round face: { centre, normal, radius, ... }")
    rectangle: Rectangle | None = Field(
        default=None, description="a rectangular face: { centre, normal, along, half_lengths, ... }"
    )
    # excluded from digests if unused, so that the digests of mechanisms older than these kinds do not change
    turned: Turned | None = Field(
        default=None, exclude_if=not_given, description="a turned solid: { point, axis, start, profile }"
    )
    extruded: Extruded | None = Field(
        default=None, exclude_if=not_given, description="an extruded solid: { point, axis, along, start, profile, ... }"
    )
    surface: FreeFormSurface | None = Field(
        default=None, exclude_if=not_given, description="faces of any shape: { patches } or a B-spline surface"
    )

    @cached_property
    def kind(self) -> str:
        """The kind of the primitive, which is its key: ``"point"``, ``"plane"``, ``"arc"``, ..."""
        return next(kind for kind in PRIMITIVES if getattr(self, kind) is not None)

    @property
    def primitive(self) -> Any:
        """The primitive itself."""
        return getattr(self, self.kind)

    @model_validator(mode="after")
    def _one_primitive(self) -> Self:
        given = [kind for kind in PRIMITIVES if getattr(self, kind) is not None]
        if len(given) != 1:
            raise refuse(
                f"has {' and '.join(given) or 'no primitive'}; "
                f"allowed: exactly one of {', '.join(PRIMITIVES)}; keep one"
            )
        return self


class Contact(PairLaw):
    """A unilateral contact with friction between two primitives; the order of a and b does not matter."""

    a: Side = Field(description="one side: { body, and one primitive, such as point, arc or plane }")
    b: Side = Field(description="the other side: { body, and one primitive }")
    offset: Length = Field(default=0.0, description="a skin subtracted from the gap")
    stiffness: Annotated[PositiveNumber | None, Quantity("stiffness")] = Field(
        default=None,
        exclude_if=not_given,
        description="the normal force per overlap, a number > 0; default: rigid, no overlap",
    )
    damping: Annotated[Annotated[Number, Field(ge=0)] | None, Quantity("damping")] = Field(
        default=None,
        exclude_if=not_given,
        description="what the normal force of a contact with a stiffness has more per closing speed, a number >= 0",
    )

    @property
    def spring(self) -> tuple[float, float]:
        """Stiffness and damping where it overlaps; 0: rigid."""
        return self.stiffness or 0.0, self.damping or 0.0

    @model_validator(mode="after")
    def _rigid_or_not(self) -> Self:
        check_spring(self)
        return self

    @cached_property
    def kind(self) -> str:
        """The pair of primitives, in the order of ``sides``: ``"point-plane"``, ``"arc-plane"``, ..."""
        return "-".join(side.kind for side in self.sides)

    @cached_property
    def sides(self) -> tuple[Side, Side]:
        """The two sides in the order of a supported pair, such as (arc, plane)."""
        return (self.a, self.b) if f"{self.a.kind}-{self.b.kind}" in PAIRS else (self.b, self.a)

    @model_validator(mode="after")
    def _supported(self) -> Self:
        if self.kind not in PAIRS:
            raise refuse(
                f"{self.a.kind} against {self.b.kind} has no gap function; "
                f"allowed pairs: {', '.join(PAIRS)}; {_remedy({self.a.kind, self.b.kind})}"
            )
        return self

    @model_validator(mode="after")
    def _fits(self) -> Self:
        first, second = self.sides
        key = f"{'a' if first is self.a else 'b'}.{first.kind}"
        one, other = first.primitive, second.primitive
        if self.kind in ("sphere-bore", "ring-bore", "sphere-socket") and one.radius >= other.radius:
            raise refuse(
                f"does not fit into the {second.kind} of radius {other.radius:g}; allowed: 0 < radius < "
                f"{other.radius:g}; make it smaller, or the {second.kind} larger",
                key=f"{key}.radius",
                value=one.radius,
            )
        if self.kind == "ring-cylinder" and one.radius <= other.radius:
            raise refuse(
                f"does not go round the cylinder of radius {other.radius:g}; allowed: radius > {other.radius:g}; "
                "make it larger, or the cylinder smaller",
                key=f"{key}.radius",
                value=one.radius,
            )
        for side, partner in ((first, second), (second, first)):
            if side.kind == "cylinder" and partner.kind in ("ring", *FLATS) and side.primitive.half_length is not None:
                end = "its two end circles, an arc each" if partner.kind in FLATS else "arcs in place of the ring"
                raise refuse(
                    f"a {partner.kind} does not see the ends of a cylinder; allowed: none; remove it, or write {end}",
                    key=f"{'a' if side is self.a else 'b'}.cylinder.half_length",
                    value=side.primitive.half_length,
                )
        return self


def _remedy(kinds: set[str]) -> str:
    """Return what to write instead of a pair that is not supported."""
    if kinds <= set(FLATS):
        return "for a face on a face write three points of one, or its edges as arcs, against the other"
    if kinds <= {"cylinder", "bore"}:
        return "for a pin in a bore or a roller on a roller write rings, circles or spheres in place of one of them"
    return "replace one side by points, spheres or arcs of its outline"
