"""What couples bodies beyond joints: sums of joint coordinates that stay 0, and pairs of gears whose teeth mesh."""

from math import pi
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, Tag, model_validator

from engine.mechanism.base import (
    Name,
    NonNegative,
    Number,
    PositiveLength,
    PositiveNumber,
    Restitution,
    TableModel,
    added,
    check_spring,
    one_of,
    optional,
    refuse,
)
from engine.mechanism.joints import Line
from engine.mechanism.quantities import Quantity


class Term(TableModel):
    """A coordinate of an ideal joint, 0 at the start: rotation of its second side about the first axis, or its way."""

    joint: Name = Field(description="an ideal revolute, prismatic or cylindrical joint")
    of: Literal["angle", "travel"] | None = optional(
        "which coordinate of a cylindrical joint; the others have only one"
    )
    # no quantity: a number of teeth has no unit, a radius that of a length, and either may be a parameter
    factor: Number = Field(
        description="what it is multiplied with, not 0: a number of teeth, a radius, a lead over 2 pi"
    )

    @model_validator(mode="after")
    def _counts(self) -> Self:
        if self.factor == 0:
            raise refuse("a factor of 0 couples nothing; allowed: any other number; correct it", key="factor", value=0)
        return self


class JointCoupling(TableModel):
    """The sum of factor times coordinate over some joints stays 0, to within half the backlash on either side."""

    distinguishing_key: ClassVar[str] = "terms"

    terms: Annotated[tuple[Term, ...], Field(min_length=2)] = Field(
        description="the coordinates, two or more: { joint, of, factor }"
    )
    backlash: Annotated[NonNegative, Quantity("number")] = Field(
        default=0.0, description="how far the first coordinate is free while the others stand, in its unit, >= 0"
    )
    restitution: Restitution = Field(default=0.0, description="the coefficient of restitution of both flanks")

    @model_validator(mode="after")
    def _each_once(self) -> Self:
        seen: set[tuple[str, str | None]] = set()
        for i, term in enumerate(self.terms):
            if (term.joint, term.of) in seen:
                text = f"{term.joint} is there twice; allowed: every coordinate once; add up the factors"
                raise refuse(text, key=f"terms.{i}.joint", value=term.joint)
            seen.add((term.joint, term.of))
        return self


class Gear(Line):
    """A spur gear with involute teeth; a deviation of its axis is its runout."""

    teeth: Annotated[int, Field(ge=3, le=10_000, strict=True)] = Field(description="the number of teeth, 3 or more")
    internal: bool = Field(default=False, description="whether it is a ring with its teeth inside")

    @property
    def sign(self) -> int:
        """-1 for a ring: its radii are negative in formulas of a pair."""
        return -1 if self.internal else 1


class GearPair(TableModel):
    """Two spur gears, or a gear in a ring: involute teeth that touch along the line of action, on either flank.

    Nothing but their bodies is named: how these are borne, on a carrier or with play, does not matter.
    """

    distinguishing_key: ClassVar[str] = "gears"
    gears: tuple[Gear, Gear] = Field(description="the two gears: { body, point, axis, teeth, internal }")
    module: PositiveLength = Field(description="the pitch diameter per tooth, a number > 0")
    pressure_angle: Annotated[Number, Field(ge=0.1, le=0.8), Quantity("angle")] = Field(
        default=0.3490658503988659, description="the pressure angle at the nominal centre distance, 0.1 to 0.8"
    )
    backlash: Annotated[NonNegative, Quantity("length")] = Field(
        default=0.0,
        description="the circumferential backlash at the nominal centre distance, a length on the pitch circle, > 0 "
        "unless the teeth have a stiffness",
    )
    restitution: Restitution = Field(default=0.0, description="the coefficient of restitution of both flanks")
    stiffness: Annotated[PositiveNumber | None, Quantity("stiffness")] = added(
        "the force of a pair of flanks per overlap along the line of action, a number > 0; default: rigid"
    )
    damping: Annotated[NonNegative | None, Quantity("damping")] = added(
        "what that force has more per closing speed, a number >= 0"
    )

    @property
    def centre_distance(self) -> float:
        """The nominal centre distance, at which the pitch circles touch, a length."""
        return 0.5 * self.module * abs(sum(gear.sign * gear.teeth for gear in self.gears))

    @property
    def spring(self) -> tuple[float, float]:
        """Stiffness and damping where the flanks overlap; 0: rigid."""
        return self.stiffness or 0.0, self.damping or 0.0

    @model_validator(mode="after")
    def _mesh(self) -> Self:
        check_spring(self)
        if self.backlash == 0.0 and self.stiffness is None:
            text = "rigid teeth that touch on both flanks would hold the distance of the axes as well; allowed: "
            raise refuse(f"{text}a number > 0, or 0 with a stiffness; give one of the two", key="backlash", value=0.0)
        pitch = pi * self.module
        if self.backlash >= pitch:
            text = f"teeth with as much play as from one to the next never touch; allowed: < {pitch:.6g}, which is pi "
            raise refuse(f"{text}times the module; correct it, or the module", key="backlash", value=self.backlash)
        first, second = self.gears
        if first.internal and second.internal:
            text = "two rings do not mesh; allowed: one ring at most; let one gear have its teeth outside"
            raise refuse(text, key="gears.1.internal", value=True)
        ring, other = (first, second) if first.internal else (second, first)
        if ring.internal and ring.teeth <= other.teeth:
            key = f"gears.{self.gears.index(ring)}.teeth"
            text = f"a gear of {other.teeth} teeth has no room in it; allowed: more than {other.teeth}; correct one"
            raise refuse(text, key=key, value=ring.teeth)
        return self


Coupling = Annotated[
    Annotated[JointCoupling, Tag("terms")] | Annotated[GearPair, Tag("gears")],
    one_of(terms="coordinates of joints", gears="two gears"),
]
