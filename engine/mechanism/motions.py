"""Prescribed (rheonomic) motions: one coordinate of a body follows a time law, whatever force that takes."""

from typing import Annotated, ClassVar

from pydantic import Field, Tag

from engine.mechanism.base import Direction, Name, Point, TableModel, one_of
from engine.mechanism.time_laws import TravelLaw, TurnLaw


class Along(TableModel):
    """A point of the moving body, and the direction of its motion, fixed in the other body."""

    point: Point = Field(default=(0.0, 0.0, 0.0), description="the point that is led, in the frame of body")
    direction: Direction = Field(description="the direction, in the frame of relative_to")


class About(TableModel):
    """The axis of the moving body's rotation, fixed in the other body."""

    axis: Direction = Field(description="the axis, in the frame of relative_to")


class Led(TableModel):
    """Base class of the prescribed motions: the two bodies that move relative to each other."""

    body: Name = Field(description="the body that is moved")
    relative_to: Name | None = Field(default=None, description="the body it is moved against; default: the world")
    phases: Annotated[tuple[Name, ...] | None, Field(min_length=1)] = Field(
        default=None,
        description="when it acts: phases that follow each other; the body is free in the others, and the way counts "
        "from where it is when the first of them begins; default: in all phases",
    )
    since: Name | None = Field(
        default=None,
        description="the phase from whose beginning the time of the law counts; until then the body is held; "
        "default: the first in which the motion acts",
    )


class Translation(Led):
    """direction . (displacement of a point of the body relative to the other body) follows a law, 0 where it begins."""

    distinguishing_key: ClassVar[str] = "along"

    along: Along = Field(description="what is led where: { point, direction }")
    law: TravelLaw = Field(description="the way as a law of time: { table }, { speed } or { amplitude, frequency }")


class Rotation(Led):
    """The angle of the body about an axis of the other body follows a law, 0 where it begins."""

    distinguishing_key: ClassVar[str] = "about"

    about: About = Field(description="the axis of the rotation: { axis }")
    law: TurnLaw = Field(description="the angle as a law of time: { table }, { speed } or { amplitude, frequency }")


Motion = Annotated[
    Annotated[Translation, Tag("along")] | Annotated[Rotation, Tag("about")],
    one_of(along="a translation", about="a rotation"),
]
