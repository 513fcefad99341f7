"""The instant at which a response is read: the end of a run, its own peak or another response's, or an event."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from engine.mechanism.base import Name, Number, TableModel, refuse
from engine.mechanism.faults import did_you_mean

MOMENTS = ("end", "maximum", "minimum")
Moment = Literal["end", "maximum", "minimum"]


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
