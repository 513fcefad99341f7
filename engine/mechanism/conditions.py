"""Conditions on responses, such as "latch_overlap > 0", and the instants at which responses are read.

A result that violates a condition of validity does not count. A response is read at the end of a run, at its own peak
or another response's, or at an event: the first instant at which another response is beyond a limit.
"""

import operator
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Discriminator, Field, PlainSerializer, Tag, WithJsonSchema, model_validator

from engine.mechanism.base import Name, Number, TableModel, refuse
from engine.mechanism.faults import did_you_mean

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


# The instant at which a response is read: the end of a run, its own peak or another response's, or an event.


class Event(TableModel):
    """The first instant at which another response is beyond a limit."""

    response: Name = Field(description="the response that is watched, a table of [responses]")
    above: Number | None = Field(default=None, description="the limit it is above from then on, in its unit")
    below: Number | None = Field(default=None, description="the limit it is below from then on, in its unit")

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
    raise refuse(
        f"no moment of a run; allowed: {', '.join(MOMENTS)}, {{ response, above }}, {{ response, below }} or "
        "{ response, peak }"
        f"{did_you_mean(str(value), MOMENTS)}"
    )


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
