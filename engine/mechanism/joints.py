"""Joints between two bodies, ideal or with play; `type = "revolute"` and `type = "clearance_revolute"` share one model.

The type alone decides: an ideal joint accepts the keys of its counterpart with play and ignores them. All have two
sides, and those with play the law of their contacts. A fixed and a planar joint have no form with play; for play, a
user writes their faces as contacts.
"""

from collections.abc import Sequence
from math import cos, sin, sqrt
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import BeforeValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from engine.mechanism.base import (
    LARGEST_NUMBER,
    SMALLEST_NUMBER,
    BodyPoint,
    Direction,
    Length,
    NonNegative,
    Number,
    OptionalLength,
    PairLaw,
    PositiveLength,
    PositiveNumber,
    Radian,
    Restitution,
    TableModel,
    added,
    are_numbers,
    check_perpendicular,
    check_spring,
    optional,
    refuse,
)
from engine.mechanism.quantities import Quantity

WIDEST = 3.0  # rad between the stops of a rotation: a little less than half a turn
LIMITS = "the stops of an ideal joint: { lower, upper, restitution } or { lower, upper, stiffness, damping }"
# what only an ideal joint has, and why one with play has not
IDEAL = {
    "limits": "a joint with play meets its stops somewhere; allowed: in an ideal joint; "
    "remove it, and write each stop as a contact",
    "friction_force": "a joint with play rubs where its faces touch; allowed: in an ideal joint; "
    "remove it, and give `friction`, the coefficient of its faces",
    "friction_torque": "a joint with play rubs where its faces touch; allowed: in an ideal joint; "
    "remove it, and give `friction`, the coefficient of its faces",
    "breakaway_force": "a joint with play has no friction of its own; allowed: in an ideal joint; remove it",
    "breakaway_torque": "a joint with play has no friction of its own; allowed: in an ideal joint; remove it",
    "one_way": "a joint with play has no motion of its own; allowed: in an ideal joint; "
    "remove it, or make the joint an ideal one",
}


class Deviation(TableModel):
    """How a part is off its drawing: its axis lies beside its true position, and is tilted about the joint's point.

    An angle about the axis counts from the axis x, y or z of the body that is most perpendicular to it.
    """

    off: Length = Field(default=0.0, description="the distance of the axis from its true position")
    way: Radian = Field(default=0.0, description="the direction of this distance, an angle about the axis")
    tilt: Annotated[Number, Field(ge=-1.5, le=1.5), Quantity("angle")] = Field(
        default=0.0, description="the angle by which the axis is tilted, from -1.5 to 1.5"
    )
    tilt_way: Radian = Field(default=0.0, description="the direction to which it is tilted, an angle about the axis")


class Line(BodyPoint):
    """A straight line that moves with a body."""

    axis: Direction = Field(description="the direction of the axis, in the frame of the body")
    deviation: Deviation | None = added("how the part is off its drawing: { off, way, tilt, tilt_way }")

    @property
    def place(self) -> tuple[float, float, float]:
        """Where the part has the point, in the frame of the body."""
        off = self.deviation
        if off is None:
            return self.point
        x, y, z = self.across(off.way)
        return self.point[0] + off.off * x, self.point[1] + off.off * y, self.point[2] + off.off * z

    @property
    def direction(self) -> tuple[float, float, float]:
        """The direction that the part's axis has, in the frame of the body, of length 1."""
        if self.deviation is None or self.deviation.tilt == 0.0:
            return self.axis
        across, tilt = self.across(self.deviation.tilt_way), self.deviation.tilt
        x, y, z = (cos(tilt) * n + sin(tilt) * e for n, e in zip(self.axis, across, strict=True))
        return x, y, z

    def across(self, angle: float) -> tuple[float, float, float]:
        """Return the unit vector across the drawn axis at an angle about it, counted as in `Deviation`."""
        n = self.axis
        least = min(range(3), key=lambda k: abs(n[k]))
        length = sqrt(1.0 - n[least] ** 2)
        e = [((k == least) - n[least] * n[k]) / length for k in range(3)]
        f = n[1] * e[2] - n[2] * e[1], n[2] * e[0] - n[0] * e[2], n[0] * e[1] - n[1] * e[0]
        x, y, z = (cos(angle) * a + sin(angle) * b for a, b in zip(e, f, strict=True))
        return x, y, z


class Joint(PairLaw):
    """Base class of all joints. A type with the prefix ``clearance_`` has play; without the prefix it is ideal."""

    SIDES: ClassVar[tuple[str, str]]
    CLEARANCE: ClassVar[str] = ""  # the key for which the joint's name alone stands; none if it is always ideal
    # the keys of all numbers that are only added to the gaps of the joint's contacts, see `face_clearance`
    CLEARANCES: ClassVar[tuple[str, ...]] = ()
    DIRECTION: ClassVar[str] = "axis"  # the key that gives the direction of a side
    type: str = Field(description="the kind of joint")

    @property
    def ideal(self) -> bool:
        """Whether the joint has no play."""
        return not self.type.startswith("clearance_")

    @property
    def sides(self) -> tuple[BodyPoint, BodyPoint]:
        """The two sides, in the order of ``SIDES``."""
        return getattr(self, self.SIDES[0]), getattr(self, self.SIDES[1])

    @property
    def axes(self) -> tuple[Any, Any] | None:
        """The joint's axis in the frames of its two sides; None when it has none."""
        first, second = self.sides
        return (first.direction, second.direction) if isinstance(first, Line) and isinstance(second, Line) else None

    def acts(self, keys: Sequence[str]) -> bool:
        """Return whether what stands under these keys has an effect: of an ideal joint only where its sides are."""
        if not self.ideal or not keys or keys[0] in IDEAL:
            return True
        return keys[0] in self.SIDES and (len(keys) == 1 or keys[1] in ("point", self.DIRECTION, "deviation"))

    def face_clearance(self, face: str) -> str:
        """Return the key of the clearance at one of the joint's contacts, ``JOINT.face`` without the joint's name."""
        return self.CLEARANCE

    def play(self, face: str) -> float:
        """Return the clearance at one of the joint's contacts [length], which is only added to its gap."""
        clearance: float = getattr(self, self.face_clearance(face))
        return clearance

    def carries(self, face: str) -> int:
        """Return the side whose body the clearance at a face is a length of: the hollow one."""
        return 0

    def with_clearance(self, clearance: float) -> Self | None:
        """Return the joint with another number for `CLEARANCE`; None if it has no play, or this might not be allowed.

        All else has been checked before and is not checked again, because each sample of a campaign has a clearance.
        """
        if self.ideal or getattr(self, self.CLEARANCE) is None or not SMALLEST_NUMBER <= clearance <= LARGEST_NUMBER:
            return None
        changed = self.model_copy(update={self.CLEARANCE: clearance})
        try:
            changed._check_clearances()
        except PydanticCustomError:
            return None
        return changed

    def _check_play(self) -> None:
        """Refuse a joint with play that cannot be made of what is given."""

    def _check_clearances(self) -> None:
        """Refuse clearances that there cannot be, in a joint whose play is otherwise as it must be."""
        self._check_play()

    @model_validator(mode="after")
    def _loose(self) -> Self:
        if not self.ideal:
            self._check_play()
            for key, text in IDEAL.items():
                if getattr(self, key, None) is not None:
                    raise refuse(text, key=key)
        for key in ("force", "torque"):
            friction, breakaway = getattr(self, f"friction_{key}", None), getattr(self, f"breakaway_{key}", None)
            if breakaway is not None and not 0 < (friction or 0.0) <= breakaway:
                given = "none" if friction is None else f"{friction:g}"
                text = f"what holds a joint is at least what slows it, friction_{key}, which is {given}; allowed: "
                text += f"0 < friction_{key} <= breakaway_{key}; correct one of the two, or remove this one"
                raise refuse(text, key=f"breakaway_{key}", value=breakaway)
        return self

    def _need(self, *keys: str) -> None:
        """Refuse the joint if one of the dotted ``keys`` is not given."""
        for key in keys:
            node: Any = self
            *tables, last = key.split(".")
            for table in tables:
                node = getattr(node, table)
            if getattr(node, last) is None:
                what = type(node).model_fields[last].description
                raise refuse(f"missing; it is {what}; add it, or make the joint an ideal one", key=key)


# How far an ideal joint goes.


class TravelLimits(TableModel):
    """The stops of a displacement: of the second side's point along the axis, from the first side's point."""

    lower: Length | None = optional("the smallest displacement; default: none")
    upper: Length | None = optional("the largest displacement; default: none")
    restitution: Restitution = Field(default=0.0, description="the coefficient of restitution of both stops")
    stiffness: Annotated[PositiveNumber | None, Quantity("stiffness")] = added(
        "the force of both stops per length beyond them, a number > 0; default: rigid"
    )
    damping: Annotated[NonNegative | None, Quantity("damping")] = added(
        "what that force has more per speed, a number >= 0"
    )

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.lower is None and self.upper is None:
            raise refuse("no stop; allowed: lower, upper or both; give one")
        if self.lower is not None and self.upper is not None and self.lower >= self.upper:
            raise refuse("allowed: lower < upper; correct one of the two", key="lower", value=self.lower)
        check_spring(self)
        return self


class AngleLimits(TableModel):
    """The stops of a rotation: of the second side about the first side's axis, 0 at the start."""

    lower: Annotated[Number, Field(le=0), Quantity("angle")] = Field(description="the smallest angle, <= 0")
    upper: Annotated[NonNegative, Quantity("angle")] = Field(description="the largest angle, >= 0")
    restitution: Restitution = Field(default=0.0, description="the coefficient of restitution of both stops")
    stiffness: Annotated[PositiveNumber | None, Quantity("torsional stiffness")] = added(
        "the torque of both stops per angle beyond them, a number > 0; default: rigid"
    )
    damping: Annotated[NonNegative | None, Quantity("torsional damping")] = added(
        "what that torque has more per speed, a number >= 0"
    )

    @model_validator(mode="after")
    def _less_than_half_a_turn(self) -> Self:
        if not 0 < self.upper - self.lower <= WIDEST:
            text = f"{self.upper - self.lower:.6g} rad apart; allowed: 0 < upper - lower <= {WIDEST:g}; "
            raise refuse(f"{text}for more, write the two stops as contacts", key="upper", value=self.upper)
        check_spring(self)
        return self


FrictionForce = Annotated[
    NonNegative | None,
    Quantity("force"),
    added("the force with which an ideal joint resists sliding, whatever it carries, a number >= 0"),
]
FrictionTorque = Annotated[
    NonNegative | None,
    Quantity("torque"),
    added("the torque with which an ideal joint resists turning, whatever it carries, a number >= 0"),
]
BreakawayForce = Annotated[
    PositiveNumber | None,
    Quantity("force"),
    added("the force at which an ideal joint that sticks begins to slide; default: friction_force"),
]
BreakawayTorque = Annotated[
    PositiveNumber | None,
    Quantity("torque"),
    added("the torque at which an ideal joint that sticks begins to turn; default: friction_torque"),
]
OneWay = Annotated[
    Literal["forward", "backward"] | None,
    added(
        "the only way in which an ideal joint moves, along or about the first side's axis (forward) or "
        "against it (backward), as a clutch or fine ratchet has it; default: both"
    ),
]


def stations(value: Any) -> tuple[float, ...]:
    """Read stations along an axis [length]: at least one, no two alike."""
    if not are_numbers(value):
        raise refuse("not a list of ring stations; allowed: one or more finite numbers; two rings resist tilting")
    if len(set(value)) != len(value):
        raise refuse("two rings at one station; allowed: different stations; remove one")
    return tuple(float(s) for s in value)


# Joints without a form with play; for play, a user writes their faces as contacts.


class Fixed(Joint):
    """Two bodies as one: the points coincide, and the bodies stay turned to each other as they are at the start."""

    SIDES: ClassVar[tuple[str, str]] = ("a", "b")
    type: Literal["fixed"] = Field(description="the kind of joint")
    a: BodyPoint = Field(description="one side: { body, point }")
    b: BodyPoint = Field(description="the other side: { body, point }")


class Face(BodyPoint):
    """A point of a plane of a body."""

    normal: Direction = Field(description="the normal of the plane, in the frame of the body")


class Planar(Joint):
    """Two planes that stay on each other: free are two displacements and the rotation about the normal."""

    SIDES: ClassVar[tuple[str, str]] = ("a", "b")
    DIRECTION: ClassVar[str] = "normal"
    type: Literal["planar"] = Field(description="the kind of joint")
    a: Face = Field(description="the plane of one body: { body, point, normal }")
    b: Face = Field(description="the plane of the other body: { body, point, normal }")

    @property
    def axes(self) -> tuple[Any, Any]:
        """The common normal in the frames of the two sides."""
        return self.a.normal, self.b.normal


# A ball in a socket.


class Ball(BodyPoint):
    """The ball; ``point`` is its centre."""

    radius: OptionalLength = optional("the radius of the ball, a number > 0")


class Spherical(Joint):
    """A ball in a socket: the centres coincide, or are at most the radial clearance apart."""

    SIDES: ClassVar[tuple[str, str]] = ("socket", "ball")
    CLEARANCE: ClassVar[str] = "radial_clearance"
    CLEARANCES: ClassVar[tuple[str, ...]] = ("radial_clearance",)
    type: Literal["spherical", "clearance_spherical"] = Field(description="the kind of joint")
    socket: BodyPoint = Field(description="the socket and its centre: { body, point }")
    ball: Ball = Field(description="the ball and its centre: { body, point, radius }")
    radial_clearance: OptionalLength = optional("socket radius minus ball radius, a number > 0")

    def _check_play(self) -> None:
        self._need("ball.radius", "radial_clearance")


# A slider in a guide: a block in a slot, or a shaft in a sleeve.


class Slideway(Line):
    """The guide's or the slider's axis, and the direction of its height."""

    normal: Direction | None = optional("the direction of the height, across the axis")

    @model_validator(mode="after")
    def _across(self) -> Self:
        if self.normal is not None:
            check_perpendicular(self.axis, self.normal, ("axis", "normal"))
        return self


class Block(TableModel):
    """A rectangular block around the slider's ``point``; its eight corners can touch the faces of the slot."""

    half_length: PositiveLength = Field(description="half the length along the axis, a number > 0")
    half_height: PositiveLength = Field(description="half the height along the normal, a number > 0")
    half_width: PositiveLength = Field(description="half the width across both, a number > 0")


class Shaft(TableModel):
    """A cylinder on the slider's axis, in a sleeve on the axis of the guide."""

    radius: PositiveLength = Field(description="the radius of the shaft, a number > 0")
    rings: Annotated[tuple[float, ...], BeforeValidator(stations), Quantity("length")] = Field(
        description="the stations of the sleeve's rings along the guide's axis, one or more numbers"
    )
    turning: Literal["held", "free"] = Field(
        default="held", description="whether rotation about the axis is held (without play) or free"
    )


class Prismatic(Joint):
    """A slider that moves along the axis of its guide. An ideal one keeps its orientation relative to the guide."""

    SIDES: ClassVar[tuple[str, str]] = ("guide", "slider")
    CLEARANCE: ClassVar[str] = "clearance"
    CLEARANCES: ClassVar[tuple[str, ...]] = ("clearance", "width_clearance")
    type: Literal["prismatic", "clearance_prismatic"] = Field(description="the kind of joint")
    limits: TravelLimits | None = added(LIMITS)
    friction_force: FrictionForce
    breakaway_force: BreakawayForce
    one_way: OneWay
    guide: Slideway = Field(description="the slot or sleeve: { body, point, axis, normal }")
    slider: Slideway = Field(description="the block or shaft: { body, point, axis, normal }")
    block: Block | None = optional("a block: { half_length, half_height, half_width }")
    shaft: Shaft | None = optional("a shaft: { radius, rings, turning }")
    clearance: OptionalLength = optional("the play on each side of the height, or around the shaft, a number > 0")
    width_clearance: OptionalLength = optional("the play of a block on each side of its width, a number > 0")

    def face_clearance(self, face: str) -> str:
        """Return the key of the clearance at a face of the slot or at a ring."""
        return "width_clearance" if face.startswith(("left", "right")) else self.CLEARANCE

    def _check_play(self) -> None:
        if (self.block is None) == (self.shaft is None):
            has = "no form" if self.block is None else "block and shaft"
            raise refuse(f"has {has}; allowed: exactly one of block, shaft; keep one, or make the joint an ideal one")
        if self.block is None:
            self._need("clearance")
            if self.width_clearance is not None:
                text = "a shaft has no width; allowed: with a block; remove it"
                raise refuse(text, key="width_clearance", value=self.width_clearance)
            return
        self._need("guide.normal", "slider.normal")
        if self.width_clearance is None:
            self._need("clearance")
