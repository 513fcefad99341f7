"""Springs, dampers, forces and torques."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field, Tag

from engine.mechanism.base import BodyPoint, Direction, Name, Number, Point, PositiveNumber, TableModel, Vector, one_of
from engine.mechanism.quantities import Quantity
from engine.mechanism.time_laws import FactorLaw

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


class LinearSpring(TableModel):
    """A force along the line between two points, k (free_length - length) + preload - c d(length)/dt; > 0 pushes."""

    type: Literal["linear"] = Field(description="the kind of spring")
    a: BodyPoint = Field(description="one end: { body, point }")
    b: BodyPoint = Field(description="the other end: { body, point }")
    stiffness: Annotated[PositiveNumber, Quantity("stiffness")] = Field(
        description="the stiffness of the spring, a number > 0"
    )
    free_length: Annotated[Number, Field(ge=0), Quantity("length")] = Field(
        description="the length without force (with the preload alone), a number >= 0"
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


class TorsionSpring(TableModel):
    """A balanced couple about an axis fixed in a.

    With phi the rotation of b relative to a, the torque on b is -k (phi - free_angle + preload) - c dphi/dt,
    and the torque on a is its opposite.
    """

    type: Literal["torsion"] = Field(description="the kind of spring")
    a: Name = Field(description="the body in which the axis is fixed")
    b: Name = Field(description="the other body")
    axis: Direction = Field(description="the axis of the couple, in the frame of a")
    stiffness: Annotated[PositiveNumber, Quantity("torsional stiffness")] = Field(
        description="the torsional stiffness, a number > 0"
    )
    free_angle: Annotated[Number, Quantity("angle")] = Field(
        description="the rotation of b relative to a without couple (before the preload)"
    )
    preload: Annotated[Number, Quantity("angle")] = Field(default=0.0, description="an angle added to the deflection")
    damping: Annotated[Number, Field(ge=0), Quantity("torsional damping")] = Field(
        default=0.0, description="torque per angular speed, a number >= 0"
    )
    actions: tuple[ActionOfTorque, ...] = Field(
        default=(), description="what its torque is passed on as, a list of actions; default: its couple"
    )


Spring = Annotated[LinearSpring | TorsionSpring, Field(discriminator="type")]


class LinearDamper(TableModel):
    """A force along the line between two points that opposes the rate of their distance, -c d(length)/dt."""

    type: Literal["linear"] = Field(description="the kind of damper")
    a: BodyPoint = Field(description="one end: { body, point }")
    b: BodyPoint = Field(description="the other end: { body, point }")
    damping: Annotated[PositiveNumber, Quantity("damping")] = Field(
        description="force per speed of its length, a number > 0"
    )


class TorsionDamper(TableModel):
    """A balanced couple about an axis fixed in a that opposes the rotation of b relative to a: -c dphi/dt."""

    type: Literal["torsion"] = Field(description="the kind of damper")
    a: Name = Field(description="the body in which the axis is fixed")
    b: Name = Field(description="the other body")
    axis: Direction = Field(description="the axis of the couple, in the frame of a")
    damping: Annotated[PositiveNumber, Quantity("torsional damping")] = Field(
        description="torque per angular speed, a number > 0"
    )


Damper = Annotated[LinearDamper | TorsionDamper, Field(discriminator="type")]


class Force(TableModel):
    """A force at a point of a body: constant, or multiplied by a time law."""

    body: Name = Field(description="the body the force acts on")
    point: Point = Field(default=(0.0, 0.0, 0.0), description="where it acts, in the body frame")
    force: Annotated[Vector, Quantity("force")] = Field(description="the force [x, y, z]")
    frame: Frame = Field(default="world", description="the axes of the force: world or body")
    law: FactorLaw | None = Field(
        default=None, description="what it is multiplied with: { table } or { amplitude, frequency }; default: 1"
    )
    phases: tuple[Name, ...] | None = Field(default=None, description="when it acts; default: in all phases")
    since: Name | None = Field(
        default=None, description="the phase from whose beginning the time of the law counts; default: the first"
    )


class Torque(TableModel):
    """A torque on a body: constant, or multiplied by a time law."""

    body: Name = Field(description="the body the torque acts on")
    torque: Annotated[Vector, Quantity("torque")] = Field(description="the torque [x, y, z]")
    frame: Frame = Field(default="world", description="the axes of the torque: world or body")
    law: FactorLaw | None = Field(
        default=None, description="what it is multiplied with: { table } or { amplitude, frequency }; default: 1"
    )
    phases: tuple[Name, ...] | None = Field(default=None, description="when it acts; default: in all phases")
    since: Name | None = Field(
        default=None, description="the phase from whose beginning the time of the law counts; default: the first"
    )
