"""Laws of time, which are factors of forces and targets of motions, and the motions. Time 0 is the start of the run.

A table may also give what depends on a length, an angle or a speed.
"""

import math
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import BeforeValidator, Field, Tag, model_validator

from engine.mechanism.base import (
    Direction,
    Name,
    Number,
    Point,
    PositiveNumber,
    TableModel,
    is_number,
    not_given,
    one_of,
    refuse,
)
from engine.mechanism.quantities import Quantity

Points = tuple[tuple[float, float], ...]


def _points(value: Any) -> Points:
    """Read two or more points [time, value] at increasing times."""
    return read_points(value, "time", "a short time apart")


def read_points(value: Any, over: str, apart: str) -> Points:
    """Read two or more points [``over``, value], the first numbers increasing; a jump is two points ``apart``."""
    rows = value if isinstance(value, list | tuple) else ()
    if len(rows) < 2 or not all(isinstance(p, list | tuple) and len(p) == 2 and all(map(is_number, p)) for p in rows):
        raise refuse(f"not a table; allowed: two or more points [{over}, value] of finite numbers; write all of them")
    points = tuple((float(t), float(y)) for t, y in rows)
    for (before, _), (after, _) in pairwise(points):
        if after <= before:
            raise refuse(
                f"{over} {after:g} comes after {over} {before:g}; allowed: increasing {over}s; sort the points, "
                f"and write a jump as two points {apart}"
            )
    return points


class TableLaw(TableModel):
    """A law given by points; constant before the first point and after the last one."""

    distinguishing_key: ClassVar[str] = "table"

    points: Annotated[Points, BeforeValidator(_points)] = Field(
        alias="table",
        description="the points [time, value], two or more, at increasing times",
        json_schema_extra={"minItems": 2},
    )
    over_quantity: ClassVar[str] = "time"
    """The physical quantity of the first numbers; empty: it depends on what the file names."""

    value_quantity: ClassVar[str]
    """The physical quantity of the values."""

    interpolation: Literal["linear", "smooth"] = Field(
        default="linear", description="between the points: linear, or smooth (monotone cubics, flat at both ends)"
    )


class FactorTable(TableLaw):
    """A table of factors, over time or over a response."""

    value_quantity: ClassVar[str] = "number"

    over: Name | None = Field(
        default=None,
        exclude_if=not_given,
        description="a response that the factor depends on, a position, angle or speed, instead of the time",
    )


class MotionTable(TableLaw):
    """A table of a motion; it starts from the pose in the file."""

    @model_validator(mode="after")
    def _starts_at_the_pose(self) -> Self:
        t, value = self.points[0]
        if t != 0 or value != 0:
            raise refuse(
                f"begins with [{t:g}, {value:g}]; allowed: [0, 0], as a motion is measured from the pose of the file; "
                "shift the table, or place the body elsewhere",
                key="table",
            )
        return self


class TravelTable(MotionTable):
    """A table of a translation."""

    value_quantity: ClassVar[str] = "length"


class TurnTable(MotionTable):
    """A table of a rotation."""

    value_quantity: ClassVar[str] = "angle"


class Sine(TableModel):
    """The keys common to all sines: their frequency, and their phase at the start."""

    distinguishing_key: ClassVar[str] = "amplitude"

    frequency: Annotated[PositiveNumber | None, Quantity("frequency")] = Field(
        default=None, description="periods per time, a number > 0"
    )
    period: Annotated[PositiveNumber | None, Quantity("time")] = Field(
        default=None, description="the period, a number > 0, instead of frequency"
    )
    phase: Annotated[Number, Quantity("angle")] = Field(
        default=0.0, description="the angle of the sine at the start of the run"
    )

    @property
    def angular_frequency(self) -> float:
        """Angle per time [rad/time]."""
        return 2 * math.pi * (1 / self.period if self.frequency is None else self.frequency)  # type: ignore[operator]

    @model_validator(mode="after")
    def _how_fast(self) -> Self:
        if (self.frequency is None) == (self.period is None):
            raise refuse("how fast is it? allowed: exactly one of frequency, period; keep or add one")
        return self


class FactorSine(Sine):
    """The factor mean + amplitude sin(2 pi frequency t + phase)."""

    amplitude: Annotated[Number, Quantity("number")] = Field(description="the amplitude of the factor")
    mean: Annotated[Number, Quantity("number")] = Field(
        default=0.0, description="the factor about which the sine swings"
    )


class TravelSine(Sine):
    """The displacement amplitude (sin(2 pi frequency t + phase) - sin(phase)): 0 at the start."""

    amplitude: Annotated[Number, Quantity("length")] = Field(description="the amplitude of the way, a length")


class TurnSine(Sine):
    """The angle amplitude (sin(2 pi frequency t + phase) - sin(phase)): 0 at the start."""

    amplitude: Annotated[Number, Quantity("angle")] = Field(description="the amplitude of the angle")


class TravelRamp(TableModel):
    """The displacement speed t."""

    distinguishing_key: ClassVar[str] = "speed"

    speed: Annotated[Number, Quantity("speed")] = Field(description="the constant speed")


class TurnRamp(TableModel):
    """The angle speed t."""

    distinguishing_key: ClassVar[str] = "speed"

    speed: Annotated[Number, Quantity("angular speed")] = Field(description="the constant angular speed")


_TABLE, _SINE, _RAMP = "points of time", "a sine", "a constant speed"

FactorLaw = Annotated[
    Annotated[FactorTable, Tag("table")] | Annotated[FactorSine, Tag("amplitude")],
    one_of(table=_TABLE, amplitude=_SINE),
]
TravelLaw = Annotated[
    Annotated[TravelTable, Tag("table")]
    | Annotated[TravelSine, Tag("amplitude")]
    | Annotated[TravelRamp, Tag("speed")],
    one_of(table=_TABLE, amplitude=_SINE, speed=_RAMP),
]
TurnLaw = Annotated[
    Annotated[TurnTable, Tag("table")] | Annotated[TurnSine, Tag("amplitude")] | Annotated[TurnRamp, Tag("speed")],
    one_of(table=_TABLE, amplitude=_SINE, speed=_RAMP),
]
Law = TableLaw | FactorSine | TravelSine | TurnSine | TravelRamp | TurnRamp


# Prescribed (rheonomic) motions: one coordinate of a body follows a time law, whatever force that takes.


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
