"""The base of all joints: two sides, the type that makes a joint ideal or loose, and the law of its contacts."""

from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from engine.mechanism.base import BodyPoint, Direction, PairLaw, PositiveLength, is_number, refuse
from engine.mechanism.quantities import Quantity


class Line(BodyPoint):
    """A straight line that moves with a body."""

    axis: Direction = Field(description="the direction of the axis, in the frame of the body")


class Joint(PairLaw):
    """Base class of all joints. A type with the prefix ``clearance_`` has play; without the prefix it is ideal."""

    SIDES: ClassVar[tuple[str, str]]
    CLEARANCE: ClassVar[str] = ""
    """The key for which the joint's name alone stands; empty if the joint exists only as an ideal one."""

    CLEARANCES: ClassVar[tuple[str, ...]] = ()
    """The keys of all numbers that are only added to the gaps of the joint's contacts, see `face_clearance`."""

    DIRECTION: ClassVar[str] = "axis"
    """The key that gives the direction of a side."""

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
        return (first.axis, second.axis) if isinstance(first, Line) and isinstance(second, Line) else None

    def acts(self, keys: Sequence[str]) -> bool:
        """Return whether what stands under these keys has an effect: of an ideal joint only its points and axes."""
        if not self.ideal or not keys:
            return True
        return keys[0] in self.SIDES and (len(keys) == 1 or keys[1] in ("point", self.DIRECTION))

    def face_clearance(self, face: str) -> str:
        """Return the key of the clearance at one of the joint's contacts, ``JOINT.face`` without the joint's name."""
        return self.CLEARANCE

    def _check_play(self) -> None:
        """Refuse a joint with play that cannot be made of what is given."""

    @model_validator(mode="after")
    def _loose(self) -> Self:
        if not self.ideal:
            self._check_play()
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


def stations(value: Any) -> tuple[float, ...] | None:
    """Read stations along an axis [length]: at least one, no two alike."""
    if value is None:
        return None
    if not isinstance(value, list | tuple) or not value or not all(map(is_number, value)):
        raise refuse("not a list of ring stations; allowed: one or more finite numbers; two rings carry tilt")
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

    radius: Annotated[PositiveLength | None, Quantity("length")] = Field(
        default=None, description="the radius of the ball, a number > 0"
    )


class Spherical(Joint):
    """A ball in a socket: the centres coincide, or are at most the radial clearance apart."""

    SIDES: ClassVar[tuple[str, str]] = ("socket", "ball")
    CLEARANCE: ClassVar[str] = "radial_clearance"
    CLEARANCES: ClassVar[tuple[str, ...]] = ("radial_clearance",)

    type: Literal["spherical", "clearance_spherical"] = Field(description="the kind of joint")
    socket: BodyPoint = Field(description="the socket and its centre: { body, point }")
    ball: Ball = Field(description="the ball and its centre: { body, point, radius }")
    radial_clearance: Annotated[PositiveLength | None, Quantity("length")] = Field(
        default=None, description="socket radius minus ball radius, a number > 0"
    )

    def _check_play(self) -> None:
        self._need("ball.radius", "radial_clearance")
