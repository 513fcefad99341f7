"""Responses that follow from others once a run is over."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from engine.mechanism.base import Name, TableModel
from engine.mechanism.conditions import ValidityCondition
from engine.mechanism.quantities import Quantity


class Derived(TableModel):
    """Base of the responses that follow from reported values, whenever these were read."""

    at: ClassVar[str] = "end"
    from_phase: ClassVar[str | None] = None
    to_phase: ClassVar[str | None] = None

    title: str = Field(default="", description="what the response is called in a report")


class ResponseDifference(Derived):
    """One response minus another, each as it is reported: a force forward minus the force back."""

    type: Literal["difference"] = Field(description="the kind of response")
    of: Annotated[tuple[Name, Name], Field(description="two responses of one quantity: the first minus the second")]


class ConditionMet(Derived):
    """1 if a condition holds for what a response reports, 0 if not: latched or not."""

    type: Literal["condition"] = Field(description="the kind of response")
    condition: ValidityCondition = Field(description='the condition, such as "latch_overlap > 0"')

    @property
    def quantity(self) -> Quantity:
        """A pure number."""
        return Quantity("number")
