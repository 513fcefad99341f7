"""What is read off a mechanism at the end of a run, and when a result does not count."""

import operator
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, PlainSerializer, WithJsonSchema, model_validator

from engine.mechanism.base import BodyPoint, Direction, Length, Model, Name, Point, refuse
from engine.mechanism.quantities import Quantity


class ContactForce(Model):
    """The normal force of a contact at the end of the run."""

    title: str = Field(default="", description="what the response is called in a report")
    type: Literal["contact_force"] = Field(description="the kind of response")
    contact: Name = Field(description="the contact, a table of [contacts]")

    @property
    def quantity(self) -> Quantity:
        """The quantity it measures: a force."""
        return Quantity("force")


class Axis(Model):
    """A straight line that moves with a body."""

    point: Point = Field(description="a point of the line, in the body frame")
    axis: Direction = Field(description="the direction of the line, in the body frame")


class Reference(Model):
    """What a position is measured from: a point of a body, or the foot point on an axis of a body."""

    body: Name = Field(description="the body the point or axis belongs to")
    point: Annotated[Point | None, Quantity("length")] = Field(default=None, description="a point: [x, y, z]")
    axis: Axis | None = Field(default=None, description="a line: { point, axis }; from its foot point")

    @model_validator(mode="after")
    def _one(self) -> Self:
        if (self.point is None) == (self.axis is None):
            raise refuse("needs one reference; allowed: exactly one of point, axis")
        return self


class ResponseDirection(Model):
    """A direction, in the axes of a body or of the world."""

    body: Name | None = Field(default=None, description="the body whose axes are meant; default: the world's")
    vector: Direction = Field(description="the direction [x, y, z]")


class Position(Model):
    """direction . (to - from) + offset at the end of the run."""

    title: str = Field(default="", description="what the response is called in a report")
    type: Literal["position"] = Field(description="the kind of response")
    from_: Reference = Field(alias="from", description="where the measure starts: { body, point or axis }")
    to: BodyPoint = Field(description="where the measure ends: { body, point }")
    direction: ResponseDirection = Field(description="along what: { vector } or { body, vector }")
    offset: Length = Field(default=0.0, description="a length added to the measure")

    @property
    def quantity(self) -> Quantity:
        """The quantity it measures: a length."""
        return Quantity("length")


Response = Annotated[ContactForce | Position, Field(discriminator="type")]

CONDITION = re.compile(r"\s*([A-Za-z][A-Za-z0-9_-]*)\s*([<>])\s*(\S+)\s*")


@dataclass(frozen=True)
class Condition:
    """A validity condition: a settled run that breaks it is ``invalid``.

    Parameters
    ----------
    response : str
        Name of a response.
    relation : str
        ``"<"`` or ``">"``.
    limit : float
        In the unit of the response.
    """

    response: str
    relation: str
    limit: float

    def __str__(self) -> str:
        return f"{self.response} {self.relation} {self.limit:.17g}"

    def holds(self, responses: Mapping[str, float]) -> bool:
        """Say whether ``responses`` (name -> value) meet the condition."""
        compare = operator.lt if self.relation == "<" else operator.gt
        return bool(compare(responses[self.response], self.limit))


def _condition(value: Any) -> Condition:
    """Read ``"response > number"``."""
    if isinstance(value, Condition):
        return value
    match = CONDITION.fullmatch(value) if isinstance(value, str) else None
    try:
        if match is None:
            raise ValueError(value)
        condition = Condition(match[1], match[2], float(match[3]))
        if not abs(condition.limit) < float("inf"):
            raise ValueError(value)
    except ValueError:
        raise refuse(
            'not a condition; allowed: "response > number" or "response < number"; '
            'write for example "latch_overlap > 0"'
        ) from None
    return condition


ValidityCondition = Annotated[
    Condition,
    BeforeValidator(_condition),
    PlainSerializer(str),
    WithJsonSchema({"type": "string", "examples": ["latch_overlap > 0"]}),
]
