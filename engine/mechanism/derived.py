"""Responses computed from other responses once a run is over."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from engine.mechanism.base import Name, TableModel
from engine.mechanism.conditions import ValidityCondition
from engine.mechanism.quantities import Quantity


class Derived(TableModel):
    """Base class of the responses computed from reported values, whenever those were read."""

    at: ClassVar[str] = "end"
    from_phase: ClassVar[str | None] = None
    to_phase: ClassVar[str | None] = None

    title: str = Field(default="", description="what the response is called in a report")


class ResponseDifference(Derived):
    """One reported response minus another, for instance the force forward minus the force back."""

    type: Literal["difference"] = Field(description="the kind of response")
    of: Annotated[tuple[Name, Name], Field(description="two responses of one quantity: the first minus the second")]


class ConditionMet(Derived):
    """1 if a condition on a reported response holds, otherwise 0; for instance latched or not."""

    type: Literal["condition"] = Field(description="the kind of response")
    condition: ValidityCondition = Field(description='the condition, such as "latch_overlap > 0"')

    @property
    def quantity(self) -> Quantity:
        """The quantity of a pure number."""
        return Quantity("number")
