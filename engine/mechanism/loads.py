"""Springs, dampers, forces, torques and prescribed motions, and the laws of time that they follow.

Time 0 is the start of the run. A table may also give what depends on a length, an angle or a speed.
"""

import math
from functools import partial
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import BeforeValidator, Field, Tag, model_validator

from engine.mechanism.base import (
    BodyPoint,
    Direction,
    Name,
    NonNegative,
    Number,
    Point,
    PositiveNumber,
    Radian,
    TableModel,
    Vector,
    added,
    are_numbers,
    one_of,
    optional,
    refuse,
)
from engine.mechanism.quantities import Quantity

Points = tuple[tuple[float, float], ...]


def read_points(value: Any, over: str, apart: str) -> Points:
    """Read two or more points [``over``, value], the first numbers increasing; a jump is two points ``apart``."""
    rows = value if isinstance(value, list | tuple) else ()
    if len(rows) < 2 or not all(are_numbers(p, 2) for p in rows):
        raise refuse(f"not a table; allowed: two or more points [{over}, value] of finite numbers; write all of them")
    points = tuple((float(t), float(y)) for t, y in rows)
    for (before, _), (after, _) in pairwise(points):
        if after <= before:
            text = f"{over} {after:g} comes after {over} {before:g}; allowed: increasing {over}s; sort the points, "
            raise refuse(f"{text}and write a jump as two points {apart}")
    return points


class TableLaw(TableModel):
    """A law given by points; constant before the first point and after the last one."""

    distinguishing_key: ClassVar[str] = "table"
    points: Annotated[Points, BeforeValidator(partial(read_points, over="time", apart="a short time apart"))] = Field(
        alias="table",
        description="the points [time, value], two or more, at increasing times",
        json_schema_extra={"minItems": 2},
    )
    over_quantity: ClassVar[str] = "time"
    value_quantity: ClassVar[str]
    interpolation: Literal["linear", "smooth"] = Field(
        default="linear", description="between the points: linear, or smooth (monotone cubics, flat at both ends)"
    )


class FactorTable(TableLaw):
    """A table of factors, over time or over a response."""

    value_quantity: ClassVar[str] = "number"
    over: Name | None = added("a response that the factor depends on, a position, angle or speed, instead of the time")


class MotionTable(TableLaw):
    """A table of a motion; it starts from the pose in the file."""

    @model_validator(mode="after")
    def _starts_at_the_pose(self) -> Self:
        t, value = self.points[0]
        if t != 0 or value != 0:
            text = f"begins with [{t:g}, {value:g}]; allowed: [0, 0], as a motion is measured from the pose of the "
            raise refuse(f"{text}file; shift the table, or place the body elsewhere", key="table")
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
    frequency: Annotated[PositiveNumber | None, Quantity("frequency")] = optional("periods per time, a number > 0")
    period: Annotated[PositiveNumber | None, Quantity("time")] = optional(
        "the period, a number > 0, instead of frequency"
    )
    phase: Radian = Field(default=0.0, description="the angle of the sine at the start of the run")

    @property
    def angular_frequency(self) -> float:
        """Angle per time [rad/time]."""
        return 2 * math.pi * (1 / self.period if self.frequency is None else self.frequency)  # type: ignore[operator]

    @model_validator(mode="after")
    def _how_fast(self) -> Self:
        if (self.frequency is None) == (self.period is None):
            raise refuse(
                "its rate is missing, or given twice; allowed: exactly one of frequency, period; keep or add one"
            )
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

    amplitude: Radian = Field(description="the amplitude of the angle")


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
    relative_to: Name | None = optional("the body it is moved against; default: the world")
    phases: Annotated[tuple[Name, ...] | None, Field(min_length=1)] = optional(
        "when it acts: phases that follow each other; the body is free in the others, and the way counts "
        "from where it is when the first of them begins; default: in all phases"
    )
    since: Name | None = optional(
        "the phase from whose beginning the time of the law counts; until then the body is held; "
        "default: the first in which the motion acts"
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


# Springs, dampers, forces and torques.

Frame = Literal["world", "body"]
Law = TableLaw | FactorSine | TravelSine | TurnSine | TravelRamp | TurnRamp
LawOfLoad = Annotated[
    FactorLaw | None,
    optional("what it is multiplied with: { table }, { table, over } or { amplitude, frequency }; default: 1"),
]
Since = Annotated[
    Name | None, optional("the phase from whose beginning the time of the law counts; default: the first")
]


class Action(TableModel):
    """The body that a spring acts on, if it acts differently from a force along its line or a couple about its axis."""

    body: Name = Field(description="the body that is acted on")


class ForceAction(Action):
    """A force at a point of a body, proportional to the force or torque of a spring."""

    distinguishing_key: ClassVar[str] = "force"
    point: Point = Field(default=(0.0, 0.0, 0.0), description="where the force acts, in the body frame")
    force: Vector


class TorqueAction(Action):
    """A torque on a body, proportional to the force or torque of a spring."""

    distinguishing_key: ClassVar[str] = "torque"
    torque: Vector


class ForceOfForce(ForceAction):
    """A force at a point of a body, proportional to the force of a spring."""

    force: Annotated[Vector, Quantity("number")] = Field(
        description="the force per force of the spring [x, y, z], in the body frame"
    )


class TorqueOfForce(TorqueAction):
    """A torque on a body, proportional to the force of a spring."""

    torque: Annotated[Vector, Quantity("length")] = Field(
        description="the torque per force of the spring [x, y, z], in the body frame"
    )


class ForceOfTorque(ForceAction):
    """A force at a point of a body, proportional to the torque of a spring."""

    force: Annotated[Vector, Quantity("per length")] = Field(
        description="the force per torque of the spring [x, y, z], in the body frame"
    )


class TorqueOfTorque(TorqueAction):
    """A torque on a body, proportional to the torque of a spring."""

    torque: Annotated[Vector, Quantity("number")] = Field(
        description="the torque per torque of the spring [x, y, z], in the body frame"
    )


_TOLD_BY = one_of(force="a force at a point", torque="a torque")
ActionOfForce = Annotated[Annotated[ForceOfForce, Tag("force")] | Annotated[TorqueOfForce, Tag("torque")], _TOLD_BY]
ActionOfTorque = Annotated[Annotated[ForceOfTorque, Tag("force")] | Annotated[TorqueOfTorque, Tag("torque")], _TOLD_BY]


# Springs and dampers whose force is a table, instead of a stiffness or a damping.


def _table(over: str, value: str, apart: str) -> Any:
    """Declare the points of a table over a length, an angle or a speed."""
    return Annotated[
        Points,
        BeforeValidator(partial(read_points, over=over, apart=apart)),
        Field(
            alias="table",
            description=f"the points [{over}, {value}], two or more, with increasing {over}s; constant outside",
            json_schema_extra={"minItems": 2},
        ),
    ]


class ForceOverLength(TableLaw):
    """The force of a spring as a table over its length."""

    over_quantity: ClassVar[str] = "length"
    value_quantity: ClassVar[str] = "force"
    points: _table("length", "force", "a small length apart")  # type: ignore[valid-type]


class TorqueOverAngle(TableLaw):
    """The torque of a torsion spring as a table over its angle."""

    over_quantity: ClassVar[str] = "angle"
    value_quantity: ClassVar[str] = "torque"
    points: _table("angle", "torque", "a small angle apart")  # type: ignore[valid-type]


class FrictionOverSpeed(TableLaw):
    """What a coefficient of friction is multiplied with, as a table over the sliding speed (Stribeck's curve)."""

    over_quantity: ClassVar[str] = "speed"
    value_quantity: ClassVar[str] = "number"
    points: _table("speed", "factor", "a small speed apart")  # type: ignore[valid-type]

    @model_validator(mode="after")
    def _resists(self) -> Self:
        for speed, factor in self.points:
            if speed < 0 or factor < 0:
                text = f"[{speed:g}, {factor:g}]: friction acts against any sliding; allowed: speeds >= 0 and factors "
                raise refuse(f"{text}>= 0; correct it", key="table")
        return self

    @property
    def at_rest(self) -> float:
        """The factor of a contact that sticks."""
        return float(self.points[0][1])


class Resistance(TableLaw):
    """Base class of the tables of dampers over their speed, which only take energy."""

    @model_validator(mode="after")
    def _takes_energy(self) -> Self:
        for speed, value in self.points:
            if speed * value < 0 or (speed == 0 and value != 0):
                raise refuse(
                    f"{value:g} at a speed of {speed:g} would drive what it is to slow down; allowed: values with the "
                    "sign of the speed, and 0 at 0; correct it, or write what drives as a force or torque with a law "
                    "over a speed",
                    key="table",
                )
        if self.points[0][0] > 0 or self.points[-1][0] < 0:
            text = f"runs from {self.points[0][0]:g} to {self.points[-1][0]:g}, and would resist at rest; allowed: "
            raise refuse(f"{text}speeds on both sides of 0; add the other side", key="table")
        return self


class ForceOverSpeed(Resistance):
    """The force of a damper as a table over the rate of its length, whose sign it has."""

    over_quantity: ClassVar[str] = "speed"
    value_quantity: ClassVar[str] = "force"
    points: _table("speed", "force", "a small speed apart")  # type: ignore[valid-type]


class TorqueOverSpeed(Resistance):
    """The torque of a torsion damper as a table over its angular speed, whose sign it has."""

    over_quantity: ClassVar[str] = "angular speed"
    value_quantity: ClassVar[str] = "torque"
    points: _table("speed", "torque", "a small speed apart")  # type: ignore[valid-type]


def _check_law(load: Any, needed: tuple[str, ...], replaced: tuple[str, ...]) -> None:
    """Refuse a load with neither its numbers nor a law in their place, or with both."""
    fields = type(load).model_fields
    for key in needed:
        if load.law is None and getattr(load, key) is None:
            raise refuse(f"missing; it is {fields[key].description}; add it, or a law = {{ table }}", key=key)
    for key in replaced:
        value = getattr(load, key)
        if load.law is not None and value != fields[key].default:
            raise refuse(f"the law gives all of it; allowed: one of {key} and law; remove one", key=key, value=value)


class LinearSpring(TableModel):
    """A force along the line between two points, k (free_length - length) + preload - c d(length)/dt; > 0 pushes."""

    type: Literal["linear"] = Field(description="the kind of spring")
    a: BodyPoint = Field(description="one end: { body, point }")
    b: BodyPoint = Field(description="the other end: { body, point }")
    stiffness: Annotated[PositiveNumber | None, Quantity("stiffness")] = optional(
        "the stiffness of the spring, a number > 0"
    )
    free_length: Annotated[NonNegative | None, Quantity("length")] = optional(
        "the length without force (with the preload alone), a number >= 0"
    )
    law: ForceOverLength | None = added(
        "the force over the length, { table }, instead of stiffness and free_length; > 0 pushes"
    )
    preload: Annotated[Number, Quantity("force")] = Field(
        default=0.0, description="the force at free_length; > 0 pushes the ends apart"
    )
    acts: Literal["both", "push", "pull"] = Field(
        default="both", description="both ways, or only while it pushes (lifts off), or only while it pulls (a rope)"
    )
    damping: Annotated[NonNegative, Quantity("damping")] = Field(
        default=0.0, description="force per speed of its length, a number >= 0"
    )
    actions: tuple[ActionOfForce, ...] = Field(
        default=(), description="what its force is passed on as, a list of actions; default: along its line"
    )

    @model_validator(mode="after")
    def _one_law(self) -> Self:
        _check_law(self, ("stiffness", "free_length"), ("stiffness", "free_length", "preload", "acts"))
        return self


class TorsionSpring(TableModel):
    """A balanced couple about an axis fixed in a.

    With phi the rotation of b relative to a, the torque on b is -k (phi - free_angle + preload) - c dphi/dt,
    and the torque on a is its opposite.
    """

    type: Literal["torsion"] = Field(description="the kind of spring")
    a: Name = Field(description="the body in which the axis is fixed")
    b: Name = Field(description="the other body")
    axis: Direction = Field(description="the axis of the couple, in the frame of a")
    stiffness: Annotated[PositiveNumber | None, Quantity("torsional stiffness")] = optional(
        "the torsional stiffness, a number > 0"
    )
    free_angle: Annotated[Number | None, Quantity("angle")] = optional(
        "the rotation of b relative to a without couple (before the preload)"
    )
    law: TorqueOverAngle | None = added(
        "the torque on b over the rotation of b relative to a, { table }, instead of stiffness, free_angle"
    )
    preload: Radian = Field(default=0.0, description="an angle added to the deflection")
    damping: Annotated[NonNegative, Quantity("torsional damping")] = Field(
        default=0.0, description="torque per angular speed, a number >= 0"
    )
    actions: tuple[ActionOfTorque, ...] = Field(
        default=(), description="what its torque is passed on as, a list of actions; default: its couple"
    )

    @model_validator(mode="after")
    def _one_law(self) -> Self:
        _check_law(self, ("stiffness", "free_angle"), ("stiffness", "free_angle", "preload"))
        return self


Spring = Annotated[LinearSpring | TorsionSpring, Field(discriminator="type")]


class LinearDamper(TableModel):
    """A force along the line between two points that opposes the rate of their distance, -c d(length)/dt."""

    type: Literal["linear"] = Field(description="the kind of damper")
    a: BodyPoint = Field(description="one end: { body, point }")
    b: BodyPoint = Field(description="the other end: { body, point }")
    damping: Annotated[PositiveNumber | None, Quantity("damping")] = optional(
        "force per speed of its length, a number > 0"
    )
    law: ForceOverSpeed | None = added(
        "the force over the rate of its length, with its sign, { table }, instead of damping"
    )

    @model_validator(mode="after")
    def _one_law(self) -> Self:
        _check_law(self, ("damping",), ("damping",))
        return self


class TorsionDamper(TableModel):
    """A balanced couple about an axis fixed in a that opposes the rotation of b relative to a: -c dphi/dt."""

    type: Literal["torsion"] = Field(description="the kind of damper")
    a: Name = Field(description="the body in which the axis is fixed")
    b: Name = Field(description="the other body")
    axis: Direction = Field(description="the axis of the couple, in the frame of a")
    damping: Annotated[PositiveNumber | None, Quantity("torsional damping")] = optional(
        "torque per angular speed, a number > 0"
    )
    law: TorqueOverSpeed | None = added(
        "the torque over the angular speed, with its sign, { table }, instead of damping"
    )

    @model_validator(mode="after")
    def _one_law(self) -> Self:
        _check_law(self, ("damping",), ("damping",))
        return self


Damper = Annotated[LinearDamper | TorsionDamper, Field(discriminator="type")]


class Force(TableModel):
    """A force at a point of a body: constant, or multiplied by a time law."""

    body: Name = Field(description="the body the force acts on")
    against: Name | None = added("the body on which the opposite force acts, at the same place; default: none")
    point: Point = Field(default=(0.0, 0.0, 0.0), description="where it acts, in the body frame")
    force: Annotated[Vector, Quantity("force")] = Field(description="the force [x, y, z]")
    frame: Frame = Field(default="world", description="the axes of the force: world or body")
    law: LawOfLoad
    phases: tuple[Name, ...] | None = optional("when it acts; default: in all phases")
    since: Since


class Torque(TableModel):
    """A torque on a body: constant, or multiplied by a time law."""

    body: Name = Field(description="the body the torque acts on")
    against: Name | None = added("the body on which the opposite torque acts; default: none")
    torque: Annotated[Vector, Quantity("torque")] = Field(description="the torque [x, y, z]")
    frame: Frame = Field(default="world", description="the axes of the torque: world or body")
    law: LawOfLoad
    phases: tuple[Name, ...] | None = optional("when it acts; default: in all phases")
    since: Since
