"""The responses of a mechanism: quantities measured, each read at an instant, and those derived from others.

A response is read at the end of a run, at its own peak or another response's, or at an event: the first instant at
which another response is beyond a limit. A result that violates a condition of validity does not count.
"""

import math
import operator
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from graphlib import TopologicalSorter
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Field,
    PlainSerializer,
    StringConstraints,
    Tag,
    WithJsonSchema,
    model_validator,
)

from engine.mechanism.base import (
    BodyPoint,
    Direction,
    Length,
    Name,
    Number,
    Point,
    PositiveNumber,
    Radian,
    TableModel,
    added,
    is_quoted_number,
    optional,
    refuse,
)
from engine.mechanism.expression import LONGEST, ExpressionFault, names_in, parse
from engine.mechanism.faults import did_you_mean
from engine.mechanism.quantities import MeasurableQuantity, Quantity

CONDITION = re.compile(r"\s*([A-Za-z][A-Za-z0-9_-]*)\s*([<>])\s*(\S+)\s*")

MOMENTS = ("end", "maximum", "minimum")
Moment = Literal["end", "maximum", "minimum"]


@dataclass(frozen=True)
class Condition:
    """A response above or below a limit. A settled run that violates one of its validity conditions is ``invalid``."""

    response: str
    relation: str  # "<" or ">"
    limit: float  # in the unit of the response

    def __str__(self) -> str:
        return f"{self.response} {self.relation} {repr(self.limit).removesuffix('.0')}"

    def holds(self, responses: Mapping[str, float]) -> bool:
        """Return whether ``responses`` (name -> value) satisfy the condition."""
        compare = operator.lt if self.relation == "<" else operator.gt
        return bool(compare(responses[self.response], self.limit))


def _condition(value: Any) -> Condition:
    """Read ``"response > number"``."""
    if isinstance(value, Condition):
        return value
    match = CONDITION.fullmatch(value) if isinstance(value, str) else None
    if match and is_quoted_number(match[3]) and abs(limit := float(match[3])) < math.inf:
        return Condition(match[1], match[2], limit)
    text = 'not a condition; allowed: "response > number" or "response < number"; write for example '
    raise refuse(f'{text}"latch_overlap > 0"')


ValidityCondition = Annotated[
    Condition,
    BeforeValidator(_condition),
    PlainSerializer(str),
    WithJsonSchema({"type": "string", "examples": ["latch_overlap > 0"]}),
]


class Event(TableModel):
    """The first instant at which another response is beyond a limit."""

    response: Name = Field(description="the response that is watched, a table of [responses]")
    above: Number | None = optional("the limit it is above from then on, in its unit")
    below: Number | None = optional("the limit it is below from then on, in its unit")

    @model_validator(mode="after")
    def _one(self) -> Self:
        if (self.above is None) == (self.below is None):
            raise refuse("needs one limit; allowed: exactly one of above, below")
        return self


class Peak(TableModel):
    """The instant at which another response is at its largest or smallest."""

    response: Name = Field(description="the response whose peak it is, a table of [responses]")
    peak: Literal["maximum", "minimum"] = Field(description="which peak: maximum or minimum")


def _moment(value: Any) -> Any:
    """Accept a table, which is an event or a peak, or the name of an instant."""
    if isinstance(value, Mapping | Event | Peak) or (isinstance(value, str) and value in MOMENTS):
        return value
    text = f"no moment of a run; allowed: {', '.join(MOMENTS)}, {{ response, above }}, {{ response, below }} or "
    raise refuse(f"{text}{{ response, peak }}{did_you_mean(str(value), MOMENTS)}")


def _kind(value: Any) -> str:
    """Return the tag of the value: Moment, Peak or Event."""
    if isinstance(value, str):
        return "Moment"
    return "Peak" if isinstance(value, Peak) or (isinstance(value, Mapping) and "peak" in value) else "Event"


At = Annotated[
    Annotated[Moment, Tag("Moment")] | Annotated[Event, Tag("Event")] | Annotated[Peak, Tag("Peak")],
    Discriminator(_kind),
    BeforeValidator(_moment),
]


# What is measured, and what follows from it.


ContactName = Annotated[str, StringConstraints(pattern=r"^[A-Za-z][A-Za-z0-9_-]*(\.[A-Za-z][A-Za-z0-9_-]*)?$")]


class Derived(TableModel):
    """Base class of the responses computed from reported values, whenever those were read."""

    at: ClassVar[str] = "end"
    from_phase: ClassVar[str | None] = None
    to_phase: ClassVar[str | None] = None

    title: str = Field(default="", description="what the response is called in a report")

    @property
    def sources(self) -> Sequence[str]:
        """The responses that it follows from, as the file names them."""
        raise NotImplementedError


class ResponseDifference(Derived):
    """One reported response minus another, for instance the force forward minus the force back."""

    type: Literal["difference"] = Field(description="the kind of response")
    of: Annotated[tuple[Name, Name], Field(description="two responses of one quantity: the first minus the second")]

    @property
    def sources(self) -> Sequence[str]:
        """The two responses."""
        return self.of


class ConditionMet(Derived):
    """1 if a condition on a reported response holds, otherwise 0; for instance latched or not."""

    type: Literal["condition"] = Field(description="the kind of response")
    condition: ValidityCondition = Field(description='the condition, such as "latch_overlap > 0"')

    @property
    def quantity(self) -> Quantity:
        """The quantity of a pure number."""
        return Quantity("number")

    @property
    def sources(self) -> Sequence[str]:
        """The response of the condition."""
        return (self.condition.response,)


def _readable(text: str) -> str:
    """Refuse a text that is not an expression."""
    try:
        parse(text)
    except ExpressionFault as fault:
        raise refuse(str(fault)) from None
    return text


class Formula(Derived):
    """An expression over reported responses and parameters, for instance ``-pull`` or ``0.5 * (there + back)``."""

    type: Literal["formula"] = Field(description="the kind of response")
    formula: Annotated[str, StringConstraints(max_length=LONGEST), AfterValidator(_readable)] = Field(
        description='the expression over responses and parameters, such as "-pull / 2"; in a name, _ stands for -'
    )
    stated: MeasurableQuantity | None = added(
        "what it measures, such as energy, where the formula does not show it", alias="quantity"
    )

    @property
    def sources(self) -> Sequence[str]:
        """The names in the formula: responses, with _ for -, and parameters."""
        return tuple(dict.fromkeys(names_in(parse(self.formula))))


def in_formulas(responses: Iterable[str]) -> dict[str, str]:
    """Return the responses by the names that they have in formulas, in which ``_`` also stands for ``-``."""
    names = list(responses)
    return {name.replace("-", "_"): name for name in names} | {name: name for name in names}


def order_of_derived(responses: Mapping[str, Any]) -> list[str]:
    """Return the names of the responses that follow from others, each after those; CycleError if one cannot."""
    known = in_formulas(responses)
    derived = {name: response for name, response in responses.items() if isinstance(response, Derived)}
    needs = {name: [known[part] for part in each.sources if part in known] for name, each in derived.items()}
    return [name for name in TopologicalSorter(needs).static_order() if name in derived]


class Measured(TableModel):
    """Base class of the measured responses: a title, and the instant at which they are read."""

    measures: ClassVar[Quantity]
    adds_up: ClassVar[bool] = False  # from the beginning of from_phase, whenever it is read
    title: str = Field(default="", description="what the response is called in a report")
    at: At = Field(
        default="end",
        description="when it is read: end of the run, maximum or minimum over it, or at an event "
        "{ response, above or below }, or at another's peak { response, peak }",
    )
    from_phase: Name | None = optional("the phase with which the search for at begins; default: the first")
    to_phase: Name | None = optional(
        "the phase with which the search for at ends, or at whose end the response is read; default: the last"
    )

    @property
    def quantity(self) -> Quantity:
        """The quantity that the response measures."""
        return self.measures

    @model_validator(mode="after")
    def _searched(self) -> Self:
        if self.from_phase is not None and self.at == "end" and not self.adds_up:
            text = "nothing is searched for when the response is read at the end; allowed with at = maximum, minimum "
            raise refuse(f"{text}or an event; remove it, or give at", key="from_phase", value=self.from_phase)
        return self


class Axis(TableModel):
    """A straight line that moves with a body."""

    point: Point = Field(description="a point of the line, in the body frame")
    axis: Direction = Field(description="the direction of the line, in the body frame")


class Reference(TableModel):
    """The reference of a position: a point of a body, or the foot point on an axis of a body."""

    body: Name = Field(description="the body the point or axis belongs to")
    point: Annotated[Point | None, Quantity("length")] = optional("a point: [x, y, z]")
    axis: Axis | None = optional("a line: { point, axis }; from its foot point")

    @model_validator(mode="after")
    def _one(self) -> Self:
        if (self.point is None) == (self.axis is None):
            raise refuse("needs one reference; allowed: exactly one of point, axis")
        return self


class ResponseDirection(TableModel):
    """A direction, in the axes of a body or of the world."""

    body: Name | None = optional("the body whose axes are meant; default: the world's")
    vector: Direction = Field(description="the direction [x, y, z]")


class Position(Measured):
    """direction . (to - from) + offset."""

    measures = Quantity("length")
    type: Literal["position"] = Field(description="the kind of response")
    from_: Reference = Field(alias="from", description="where the measure starts: { body, point or axis }")
    to: BodyPoint = Field(description="where the measure ends: { body, point }")
    direction: ResponseDirection = Field(description="along what: { vector } or { body, vector }")
    offset: Length = Field(default=0.0, description="a length added to the measure")


class Velocity(Measured):
    """The rate of direction . (to - from)."""

    measures = Quantity("speed")
    type: Literal["velocity"] = Field(description="the kind of response")
    from_: Reference | None = optional(
        "what the speed is relative to: { body, point or axis }; default: the world", alias="from"
    )
    to: BodyPoint = Field(description="the point whose speed it is: { body, point }")
    direction: ResponseDirection = Field(description="along what: { vector } or { body, vector }")


class Turning(Measured):
    """A body that turns about an axis of another body."""

    body: Name = Field(description="the body that turns")
    relative_to: Name | None = optional("the body in which the axis is fixed; default: the world")
    axis: Direction = Field(description="the axis, in the frame of relative_to")

    @model_validator(mode="after")
    def _two(self) -> Self:
        if self.body == self.relative_to:
            text = "a body does not turn relative to itself; allowed: another body, or the world; remove it"
            raise refuse(text, key="relative_to", value=self.relative_to)
        return self


class Angle(Turning):
    """The angle by which a body has turned about an axis since the start, including full turns, plus an offset."""

    measures = Quantity("angle")
    type: Literal["angle"] = Field(description="the kind of response")
    offset: Radian = Field(default=0.0, description="an angle added to the measure")


class AngularVelocity(Turning):
    """The angular velocity of a body about an axis."""

    measures = Quantity("angular speed")
    type: Literal["angular_velocity"] = Field(description="the kind of response")


class Gap(Measured):
    """The gap of a contact as computed by its gap function; for a ring, its clearance minus its eccentricity."""

    measures = Quantity("length")
    type: Literal["gap"] = Field(description="the kind of response")
    contact: ContactName = Field(description="the contact: a table of [contacts], or one of a joint, such as J1.ring1")


class ContactImpulse(Measured):
    """The normal force of a contact, added up over time."""

    measures = Quantity("impulse")
    adds_up = True
    type: Literal["contact_impulse"] = Field(description="the kind of response")
    contact: ContactName = Field(description="the contact: a table of [contacts], or one of a joint, such as J1.ring1")


class Force(Measured):
    """A force that contacts transmit."""

    measures = Quantity("force")
    averaged_over: Annotated[PositiveNumber | None, Quantity("time")] = added(
        "time constant of a mean over the past, as a load cell shows it behind a filter of first order; "
        "default: the force of one step, which at an impact depends on the step"
    )


class ContactForce(Force):
    """The force of a contact: the normal force, or the magnitude of the friction force."""

    type: Literal["contact_force"] = Field(description="the kind of response")
    contact: ContactName = Field(description="the contact: a table of [contacts], or one of a joint, such as J1.ring1")
    component: Literal["normal", "friction"] = Field(
        default="normal", description="which part of the force: normal or friction"
    )
    bound: Literal["least", "largest"] | None = optional(
        "in the place of the force the least or the largest normal force that friction allows at rest, "
        "as where contacts stick forces are not unique; default: the force"
    )

    @model_validator(mode="after")
    def _bounded(self) -> Self:
        if self.bound is not None and (self.component != "normal" or self.at != "end" or self.averaged_over):
            text = "a bound is that of a normal force at rest; allowed with component = normal and at = end, without "
            raise refuse(f"{text}averaged_over; remove it", key="bound", value=self.bound)
        return self


class JointForce(Force):
    """The resultant of all contact forces of a joint with clearance, or the force of a bushing, on its second side."""

    type: Literal["joint_force"] = Field(description="the kind of response")
    joint: Name = Field(description="the joint, one with clearance, a bushing or beam")
    direction: ResponseDirection | None = optional(
        "the component along { vector } or { body, vector }; default: the magnitude"
    )


class JointTorque(Force):
    """The torque of a bushing or beam on its body b, about its point or its middle."""

    measures = Quantity("torque")
    type: Literal["joint_torque"] = Field(description="the kind of response")
    joint: Name = Field(description="the joint, a bushing or beam")
    direction: ResponseDirection | None = optional(
        "the component about { vector } or { body, vector }; default: the magnitude"
    )


class SpringForce(Measured):
    """The force of a linear spring; positive values push its points apart."""

    measures = Quantity("force")
    type: Literal["spring_force"] = Field(description="the kind of response")
    spring: Name = Field(description="the spring, one with type linear")


class SpringTorque(Measured):
    """The torque of a torsion spring on its body b about its axis."""

    measures = Quantity("torque")
    type: Literal["spring_torque"] = Field(description="the kind of response")
    spring: Name = Field(description="the spring, one with type torsion")


class OfMotion(TableModel):
    """Base class of what is measured of a prescribed motion."""

    motion: Name = Field(description="the motion, a table of [motions]")


class MotionTravel(Measured, OfMotion):
    """How far a prescribed motion has come since it began: a length, or for a rotation an angle."""

    measures = Quantity("length")
    type: Literal["motion_travel"] = Field(description="the kind of response")


class MotionForce(Force, OfMotion):
    """The force with which a translation moves its body, positive along its direction."""

    type: Literal["motion_force"] = Field(description="the kind of response")


class MotionTorque(Force, OfMotion):
    """The torque with which a rotation moves its body, positive about its axis."""

    measures = Quantity("torque")
    type: Literal["motion_torque"] = Field(description="the kind of response")


class MotionWork(Measured, OfMotion):
    """The work that a prescribed motion does on its body, added up over time."""

    measures = Quantity("energy")
    adds_up = True
    type: Literal["motion_work"] = Field(description="the kind of response")


def _window(value: tuple[float, float] | None) -> tuple[float, float] | None:
    """Refuse a window that ends before it begins."""
    if value is not None and not 0 <= value[0] < value[1]:
        raise refuse("not a window of time; allowed: [begin, end] with 0 <= begin < end; correct it")
    return value


class Accumulated(Measured):
    """Base class of what is added up over the time of another response, from the beginning of ``from_phase``."""

    adds_up = True
    response: Name = Field(description="the response, measured in each step, a table of [responses]")
    window: Annotated[tuple[Number, Number] | None, Quantity("time"), AfterValidator(_window)] = optional(
        "[begin, end] of the time that counts, since the beginning of from_phase; default: all of it"
    )


class Impulse(Accumulated):
    """The integral of a force over time."""

    measures = Quantity("impulse")
    type: Literal["impulse"] = Field(description="the kind of response")


class Mean(Accumulated):
    """The mean of a response over time."""

    type: Literal["mean"] = Field(description="the kind of response")


class Bounces(Measured):
    """How often a contact that has carried load opens again."""

    measures = Quantity("number")
    adds_up = True
    type: Literal["bounces"] = Field(description="the kind of response")
    contact: ContactName = Field(description="the contact: a table of [contacts], or one of a joint, such as J1.ring1")
    opening: Annotated[Number | None, Field(ge=0), Quantity("length")] = optional(
        "the gap from which it counts as open; default: the penetration of [simulation]"
    )


class FrictionWork(Measured):
    """The energy that friction at a contact has taken, added up over time."""

    measures = Quantity("energy")
    adds_up = True
    type: Literal["friction_work"] = Field(description="the kind of response")
    contact: ContactName = Field(description="the contact: a table of [contacts], or one of a joint, such as J1.ring1")


class Time(Measured):
    """The time from the start of the run to its end or to an event."""

    measures = Quantity("time")
    type: Literal["time"] = Field(description="the kind of response")

    @model_validator(mode="after")
    def _no_peak(self) -> Self:
        if self.at in ("maximum", "minimum"):
            text = "time has no peak; allowed: end, { response, above } or { response, below }; give the event"
            raise refuse(text, key="at", value=self.at)
        return self


Response = Annotated[
    Position
    | Velocity
    | Angle
    | AngularVelocity
    | Gap
    | ContactImpulse
    | ContactForce
    | JointForce
    | JointTorque
    | SpringForce
    | SpringTorque
    | MotionTravel
    | MotionForce
    | MotionTorque
    | MotionWork
    | Impulse
    | Mean
    | Bounces
    | FrictionWork
    | Time
    | ResponseDifference
    | ConditionMet
    | Formula,
    Field(discriminator="type"),
]
