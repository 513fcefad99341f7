"""A ball in a socket."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from engine.mechanism.base import BodyPoint, PositiveLength
from engine.mechanism.joints.base import Joint
from engine.mechanism.quantities import Quantity


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
