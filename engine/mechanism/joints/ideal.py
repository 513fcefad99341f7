"""Joints without a form with play; for play, a user writes their faces as contacts."""

from typing import Any, ClassVar, Literal

from pydantic import Field

from engine.mechanism.base import BodyPoint, Direction
from engine.mechanism.joints.base import Joint


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
