"""Springs, dampers, forces and torques."""

from functools import partial
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import BeforeValidator, Field, Tag, model_validator

from engine.mechanism.base import (
    BodyPoint,
    Direction,
    Name,
    Number,
    Point,
    PositiveNumber,
    TableModel,
    Vector,
    not_given,
    one_of,
    refuse,
)
from engine.mechanism.quantities import Quantity
from engine.mechanism.time_laws import FactorLaw, Points, TableLaw, read_points

Frame = Literal["world", "body"]


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
ActionOfForce = Annotated[
    Annotated[ForceOfForce, Tag("force")] | Annotated[TorqueOfForce, Tag("torque")],
    _TOLD_BY,
]
ActionOfTorque = Annotated[
    Annotated[ForceOfTorque, Tag("force")] | Annotated[TorqueOfTorque, Tag("torque")],
    _TOLD_BY,
]


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
            raise refuse(
                f"runs from {self.points[0][0]:g} to {self.points[-1][0]:g}, and would resist at rest; allowed: "
                "speeds on both sides of 0; add the other side",
                key="table",
            )
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
    stiffness: Annotated[PositiveNumber | None, Quantity("stiffness")] = Field(
        default=None, description="the stiffness of the spring, a number > 0"
    )
    free_length: Annotated[Annotated[Number, Field(ge=0)] | None, Quantity("length")] = Field(
        default=None, description="the length without force (with the preload alone), a number >= 0"
    )
    law: ForceOverLength | None = Field(
        default=None,
        exclude_if=not_given,
        description="the force over the length, { table }, instead of stiffness and free_length; > 0 pushes",
    )
    preload: Annotated[Number, Quantity("force")] = Field(
        default=0.0, description="the force at free_length; > 0 pushes the ends apart"
    )
    acts: Literal["both", "push", "pull"] = Field(
        default="both", description="both ways, or only while it pushes (lifts off), or only while it pulls (a rope)"
    )
    damping: Annotated[Number, Field(ge=0), Quantity("damping")] = Field(
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
    stiffness: Annotated[PositiveNumber | None, Quantity("torsional stiffness")] = Field(
        default=None, description="the torsional stiffness, a number > 0"
    )
    free_angle: Annotated[Number | None, Quantity("angle")] = Field(
        default=None, description="the rotation of b relative to a without couple (before the preload)"
    )
    law: TorqueOverAngle | None = Field(
        default=None,
        exclude_if=not_given,
        description="the torque on b over the rotation of b relative to a, { table }, instead of stiffness, free_angle",
    )
    preload: Annotated[Number, Quantity("angle")] = Field(default=0.0, description="an angle added to the deflection")
    damping: Annotated[Number, Field(ge=0), Quantity("torsional damping")] = Field(
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
    damping: Annotated[PositiveNumber | None, Quantity("damping")] = Field(
        default=None, description="force per speed of its length, a number > 0"
    )
    law: ForceOverSpeed | None = Field(
        default=None,
        exclude_if=not_given,
        description="the force over the rate of its length, with its sign, { table }, instead of damping",
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
    damping: Annotated[PositiveNumber | None, Quantity("torsional damping")] = Field(
        default=None, description="torque per angular speed, a number > 0"
    )
    law: TorqueOverSpeed | None = Field(
        default=None,
        exclude_if=not_given,
        description="the torque over the angular speed, with its sign, { table }, instead of damping",
    )

    @model_validator(mode="after")
    def _one_law(self) -> Self:
        _check_law(self, ("damping",), ("damping",))
        return self


Damper = Annotated[LinearDamper | TorsionDamper, Field(discriminator="type")]


class Force(TableModel):
    """A force at a point of a body: constant, or multiplied by a time law."""

    body: Name = Field(description="the body the force acts on")
    against: Name | None = Field(
        default=None,
        exclude_if=not_given,
        description="the body on which the opposite force acts, at the same place; default: none",
    )
    point: Point = Field(default=(0.0, 0.0, 0.0), description="where it acts, in the body frame")
    force: Annotated[Vector, Quantity("force")] = Field(description="the force [x, y, z]")
    frame: Frame = Field(default="world", description="the axes of the force: world or body")
    law: FactorLaw | None = Field(
        default=None,
        description="what it is multiplied with: { table }, { table, over } or { amplitude, frequency }; default: 1",
    )
    phases: tuple[Name, ...] | None = Field(default=None, description="when it acts; default: in all phases")
    since: Name | None = Field(
        default=None, description="the phase from whose beginning the time of the law counts; default: the first"
    )


class Torque(TableModel):
    """A torque on a body: constant, or multiplied by a time law."""

    body: Name = Field(description="the body the torque acts on")
    against: Name | None = Field(
        default=None, exclude_if=not_given, description="the body on which the opposite torque acts; default: none"
    )
    torque: Annotated[Vector, Quantity("torque")] = Field(description="the torque [x, y, z]")
    frame: Frame = Field(default="world", description="the axes of the torque: world or body")
    law: FactorLaw | None = Field(
        default=None,
        description="what it is multiplied with: { table }, { table, over } or { amplitude, frequency }; default: 1",
    )
    phases: tuple[Name, ...] | None = Field(default=None, description="when it acts; default: in all phases")
    since: Name | None = Field(
        default=None, description="the phase from whose beginning the time of the law counts; default: the first"
    )
