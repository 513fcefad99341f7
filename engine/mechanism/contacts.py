"""Unilateral contacts between two primitives: shapes fixed to a body, whose distances have a closed form or almost.

Lengths and directions are in the frame of the body. A face is the top of a plate: a body that slides over its edge
meets the side of the plate, and one that has come more than half its depth behind it is let out at the back.
"""

import math
from functools import cached_property
from typing import Annotated, Any, Self

from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from engine.mechanism.base import (
    Direction,
    Each,
    Length,
    Name,
    NonNegative,
    OptionalLength,
    PairLaw,
    Point,
    PositiveLength,
    PositiveNumber,
    TableModel,
    added,
    check_one_at_rest,
    check_perpendicular,
    check_spring,
    numbers_or,
    optional,
    refuse,
)
from engine.mechanism.closed_profiles import Extruded, Piece, Turned
from engine.mechanism.loads import FrictionOverSpeed
from engine.mechanism.meshes.mesh import Mesh
from engine.mechanism.quantities import Quantity
from engine.mechanism.surfaces.surface import FreeFormSurface

_TWO_SIZES = {"type": "array", "items": {"type": "number", "exclusiveMinimum": 0}, "minItems": 2, "maxItems": 2}


_THREE_SIZES = {**_TWO_SIZES, "minItems": 3, "maxItems": 3}
_three_sizes = numbers_or(
    "not three half sides; allowed: three finite numbers > 0; write half the length, the width and the height",
    3,
    lambda sizes: min(sizes) > 0,
)
_two_sizes = numbers_or(
    "not two half sides; allowed: two finite numbers > 0; write half the length and half the width",
    2,
    lambda sizes: min(sizes) > 0,
)


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
    middle: Direction | None = optional(
        "the direction from the centre to the middle of the arc; a full circle needs none"
    )
    radius: PositiveLength = Field(description="the radius of the arc, a number > 0")
    half_angle: Annotated[PositiveNumber, Field(le=3.1415926535897936), Quantity("angle")] = Field(
        default=math.pi, description="half the angle the arc spans, in rad; pi for a full circle"
    )
    edge_radius: Annotated[NonNegative, Quantity("length")] = Field(
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
    half_length: OptionalLength = optional("half the length between the flat ends, a number > 0; default: without ends")


class Bore(TableModel):
    """The inside of a cylinder; with ends it is a hole through a plate."""

    point: Point = Field(description="the point of the axis at mid-height of the working patch")
    axis: Direction = Field(description="the direction of the bore's axis")
    radius: PositiveLength = Field(description="the radius of the bore, a number > 0")
    half_length: OptionalLength = optional("half the length of the hole, a number > 0; default: without ends")


class Capsule(TableModel):
    """The outside of a pin with round ends: all that is within a radius of a line; ``point`` is the line's middle."""

    point: Point = Field(description="the middle of the line between the centres of the two ends")
    axis: Direction = Field(description="the direction of the line")
    half_length: PositiveLength = Field(description="half the length of the line, without the ends, a number > 0")
    radius: PositiveLength = Field(description="the radius of the pin and of its ends, a number > 0")

    @cached_property
    def curve(self) -> tuple[Piece, ...]:
        """Half of its section as that of a turned solid, see `closed_profiles.Turned.curve`."""
        h, r = 1j * self.half_length, self.radius
        return Piece(-h - 1j * r, r - h, -h), Piece(r - h, r + h), Piece(r + h, h + 1j * r, h)


class Box(TableModel):
    """A box; its first side is along ``along``, its third along ``normal``, the second across both."""

    centre: Point = Field(description="the centre of the box, in the body frame")
    along: Direction = Field(default=(1.0, 0.0, 0.0), description="the direction of the first side")
    normal: Direction = Field(default=(0.0, 0.0, 1.0), description="the direction of the third side")
    half_lengths: Annotated[
        tuple[float, float, float],
        BeforeValidator(_three_sizes),
        WithJsonSchema(_THREE_SIZES),
        Quantity("length"),
        Each(gt=0.0),
    ] = Field(description="half the three sides, along `along`, across, and along `normal`, three numbers > 0")

    @model_validator(mode="after")
    def _square(self) -> Self:
        check_perpendicular(self.normal, self.along, ("normal", "along"))
        return self


class Plane(TableModel):
    """A plane; its normal points to the free side."""

    point: Point = Field(description="a point of the plane, in the body frame")
    normal: Direction = Field(description="the normal of the plane, pointing to the free side")


class Disc(TableModel):
    """A round face: the top of a round plate."""

    centre: Point = Field(description="the centre of the face, in the body frame")
    normal: Direction = Field(description="the normal of the face, pointing to the free side")
    radius: PositiveLength = Field(description="the radius of the face, a number > 0")
    depth: OptionalLength = optional("the thickness of the plate behind the face, a number > 0; default: the radius")


class Rectangle(TableModel):
    """A rectangular face: the top of a rectangular plate."""

    centre: Point = Field(description="the centre of the face, in the body frame")
    normal: Direction = Field(description="the normal of the face, pointing to the free side")
    along: Direction = Field(description="the direction of the face's first side")
    half_lengths: Annotated[
        tuple[float, float], BeforeValidator(_two_sizes), WithJsonSchema(_TWO_SIZES), Quantity("length"), Each(gt=0.0)
    ] = Field(description="half the sides of the face, along `along` and across it, two numbers > 0")
    depth: OptionalLength = optional(
        "the thickness of the plate behind the face, a number > 0; default: the smaller half side"
    )

    @model_validator(mode="after")
    def _in_plane(self) -> Self:
        check_perpendicular(self.normal, self.along, ("normal", "along"))
        return self


# Unilateral contacts between two named primitives.


PRIMITIVES = (
    *("point", "sphere", "arc", "ring", "cylinder", "bore", "socket", "plane", "disc", "rectangle"),
    *("turned", "extruded", "surface", "capsule", "box", "mesh"),
)

SOLIDS = ("cylinder", "bore", "sphere", "socket", "turned", "extruded", "surface", "capsule", "box")
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
OUTLINES = "extruded-extruded"
SEVERAL = (
    *(OUTLINES, "capsule-plane", "capsule-capsule", "capsule-cylinder", "cylinder-cylinder"),
    *("box-plane", "box-box", "capsule-box", "cylinder-box"),
    *("point-mesh", "sphere-mesh", "capsule-mesh", "box-mesh", "mesh-plane", "mesh-mesh"),
)
"""The pairs that touch at several points at once; in a run each is a contact of its own."""


class Side(TableModel):
    """One side of a contact: a body, and exactly one primitive fixed to it."""

    body: Name = Field(description="the body the primitive belongs to")
    point: Annotated[Point | None, Quantity("length")] = optional("a point: [x, y, z]")
    sphere: Sphere | None = optional("a sphere: { centre, radius }")
    arc: Arc | None = optional("an arc, circle or rounded edge: { centre, normal, radius, ... }")
    ring: Ring | None = optional("a ring: { centre, radius }")
    cylinder: Cylinder | None = optional("a cylinder: { point, axis, radius, ... }")
    bore: Bore | None = optional("the inside of a cylinder: { point, axis, radius, ... }")
    socket: Socket | None = optional("the inside of a sphere: { centre, radius }")
    plane: Plane | None = optional("a plane: { point, normal }")
    disc: Disc | None = optional("a round face: { centre, normal, radius, ... }")
    rectangle: Rectangle | None = optional("a rectangular face: { centre, normal, along, half_lengths, ... }")
    # excluded from digests if unused, so that the digests of mechanisms older than these kinds do not change
    turned: Turned | None = added("a turned solid: { point, axis, start, profile }")
    extruded: Extruded | None = added("an extruded solid: { point, axis, along, start, profile, ... }")
    surface: FreeFormSurface | None = added("faces of any shape: { patches } or a B-spline surface")
    capsule: Capsule | None = added("a pin with round ends: { point, axis, half_length, radius }")
    box: Box | None = added("a box: { centre, half_lengths, ... }")
    grain: Direction | None = added(
        "the direction of the grain of this side's surface, in the body frame: along it acts friction, across it "
        "friction_across"
    )
    mesh: Mesh | None = added("a solid from a mesh file, in convex pieces: { file, ... }")

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
            has = " and ".join(given) or "no primitive"
            raise refuse(f"has {has}; allowed: exactly one of {', '.join(PRIMITIVES)}; keep one")
        if self.grain is not None and self.kind in FLATS:
            check_perpendicular(self.primitive.normal, self.grain, ("normal", "grain"))
        return self


class Contact(PairLaw):
    """A unilateral contact with friction between two primitives; the order of a and b does not matter."""

    a: Side = Field(description="one side: { body, and one primitive, such as point, arc or plane }")
    b: Side = Field(description="the other side: { body, and one primitive }")
    offset: Length = Field(default=0.0, description="a skin subtracted from the gap")
    friction_across: Annotated[PositiveNumber | None, Quantity("number")] = added(
        "the coefficient of friction across the grain of a side, a number > 0; default: the material's, unless "
        "friction is given"
    )
    friction_over_speed: FrictionOverSpeed | None = added(
        "what friction is multiplied with, over the sliding speed: { table }; default: the material's, unless friction "
        "or static_friction is given; else 1"
    )
    rolling_friction: Annotated[NonNegative | None, Quantity("length")] = added(
        "the largest moment against rolling per normal force, a length >= 0; default: the material's"
    )
    spinning_friction: Annotated[NonNegative | None, Quantity("length")] = added(
        "the largest moment about the normal per normal force, against spinning, a length >= 0; default: the material's"
    )
    stiffness: Annotated[PositiveNumber | None, Quantity("stiffness")] = added(
        "the normal force per overlap, a number > 0; default: rigid, no overlap"
    )
    hertz_stiffness: Annotated[PositiveNumber | None, Quantity("Hertz stiffness")] = added(
        "in place of stiffness: the normal force per overlap to the power 3/2, a number > 0"
    )
    damping: Annotated[NonNegative | None, Quantity("damping")] = added(
        "what the normal force of a contact with a stiffness has more per closing speed, a number >= 0"
    )

    @property
    def spring(self) -> tuple[float, float]:
        """Stiffness and damping where it overlaps; 0: rigid."""
        return self.stiffness or self.hertz_stiffness or 0.0, self.damping or 0.0

    @cached_property
    def kind(self) -> str:
        """The pair of primitives, in the order of ``sides``: ``"point-plane"``, ``"arc-plane"``, ..."""
        return "-".join(side.kind for side in self.sides)

    @cached_property
    def sides(self) -> tuple[Side, Side]:
        """The two sides in the order of a supported pair, such as (arc, plane)."""
        return (self.a, self.b) if f"{self.a.kind}-{self.b.kind}" in (*PAIRS, *SEVERAL) else (self.b, self.a)

    @property
    def grained(self) -> Side | None:
        """The side that has a grain."""
        return next((side for side in (self.a, self.b) if side.grain is not None), None)

    @model_validator(mode="after")
    def _has_one_grain(self) -> Self:
        if self.grained is None:
            if self.friction_across is not None:
                text = "across what? allowed: with the grain of a side; add a grain = [x, y, z] to a or b, or remove it"
                raise refuse(text, key="friction_across", value=self.friction_across)
            return self
        if self.a.grain is not None and self.b.grain is not None:
            text = "side a has a grain, too; allowed: one of the two; keep that of the rougher surface"
            raise refuse(text, key="b.grain", value=list(self.b.grain))
        if hollow := {"ring", "socket"} & {self.a.kind, self.b.kind}:
            text = f"a {hollow.pop()} has no direction in its surface where its partner is in the middle; allowed: "
            text += "none; remove it and friction_across, or write a cylinder or bore with spheres or arcs"
            key = "a.grain" if self.grained is self.a else "b.grain"
            raise refuse(text, key=key, value=list(self.grained.grain or ()))
        return self

    @model_validator(mode="after")
    def _fits(self) -> Self:
        check_spring(self)
        check_one_at_rest(self)
        if self.kind not in (*PAIRS, *SEVERAL):
            kinds = list(dict.fromkeys((self.a.kind, self.b.kind)))
            allowed = "; ".join(f"{kind} against {', '.join(_partners(kind))}" for kind in kinds)
            text = f"{self.a.kind} against {self.b.kind} has no gap function; allowed: {allowed}; "
            raise refuse(text + _remedy(set(kinds)))
        first, second = self.sides
        key = f"{'a' if first is self.a else 'b'}.{first.kind}"
        one, other = first.primitive, second.primitive
        if self.kind in ("sphere-bore", "ring-bore", "sphere-socket") and one.radius >= other.radius:
            text = f"does not fit into the {second.kind} of radius {other.radius:g}; allowed: 0 < radius < "
            text += f"{other.radius:g}; make it smaller, or the {second.kind} larger"
            raise refuse(text, key=f"{key}.radius", value=one.radius)
        if self.kind == "ring-cylinder" and one.radius <= other.radius:
            text = f"does not go round the cylinder of radius {other.radius:g}; allowed: radius > {other.radius:g}; "
            raise refuse(f"{text}make it larger, or the cylinder smaller", key=f"{key}.radius", value=one.radius)
        if self.kind in SEVERAL and self.spring[0]:
            text = f"{self.kind.replace('-', ' and ')} touch at several points, and are rigid against each other; "
            text += "allowed: none; remove it, or hold one of the bodies by a spring"
            key = "stiffness" if self.stiffness else "hertz_stiffness"
            raise refuse(text, key=key, value=self.spring[0])
        if self.kind == "cylinder-cylinder" and one.half_length is None and other.half_length is None:
            text = "missing; two cylinders without ends do not tell where they touch while they are parallel; "
            raise refuse(f"{text}allowed: one without ends; add it", key=f"{key}.half_length")
        for side, partner in ((first, second), (second, first)):
            if side.kind == "cylinder" and partner.kind in ("ring", *FLATS) and side.primitive.half_length is not None:
                end = "its two end circles, an arc each" if partner.kind in FLATS else "arcs in place of the ring"
                text = f"a {partner.kind} does not see the ends of a cylinder; allowed: none; remove it, or write {end}"
                where = f"{'a' if side is self.a else 'b'}.cylinder.half_length"
                raise refuse(text, key=where, value=side.primitive.half_length)
        return self


def _partners(kind: str) -> list[str]:
    """Return what a primitive can touch."""
    pairs = [pair.split("-") for pair in (*PAIRS, *SEVERAL)]
    met = {other for pair in pairs for one, other in (pair, pair[::-1]) if one == kind}
    return [each for each in PRIMITIVES if each in met]


def _remedy(kinds: set[str]) -> str:
    """Return what to write instead of a pair that is not supported."""
    if "mesh" in kinds:
        return "for a pin write a capsule, for a face the plane it lies in, for any other solid a mesh of it"
    if "extruded" in kinds and kinds & {"cylinder", "capsule", "box"}:
        return "for a pin or a block write its section as an extruded profile, or for a pin a sphere in its middle"
    if kinds <= set(FLATS):
        return "for a face on a face write three points of one, or its edges as arcs, against the other"
    if kinds <= {"cylinder", "bore"}:
        return "for a pin in a bore write rings, circles or spheres in place of the pin"
    return "replace one side by points, spheres or arcs of its outline"
