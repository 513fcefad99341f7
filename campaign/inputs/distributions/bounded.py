"""Distributions whose definition includes two ends."""

from typing import Annotated

from pydantic import Field

from campaign.inputs.distributions.base import check_order
from campaign.inputs.distributions.continuous import Continuous
from engine.mechanism.base import Number

Within = Annotated[tuple[Number, Number], Field(strict=False)]


class Bounded(Continuous):
    """A distribution whose ``lower`` and ``upper`` are part of its definition; they hold in every production batch."""

    lower: Number = Field(description="Lower end of the distribution, in the target's unit; below the upper end.")
    upper: Number = Field(description="Upper end of the distribution, in the target's unit; above the lower end.")

    @property
    def width(self) -> float:
        """Distance between the ends."""
        return self.upper - self.lower

    def parent_support(self) -> tuple[float, float]:
        return self.lower, self.upper


class Cut(Bounded):
    """A distribution between two ends that may be cut further."""

    within: Within | None = Field(
        default=None,
        description="Bounds [low, high] between the ends at which the distribution is cut, in the target's unit.",
    )

    def cut(self) -> tuple[float, float]:
        """Return the bounds to which the distribution is cut."""
        return self.within or (self.lower, self.upper)

    def check_parameters(self) -> None:
        """Raise ValueError unless ``within`` lies between the ends."""
        if self.within is None:
            return
        check_order(*self.within)
        if not self.lower <= self.within[0] or not self.within[1] <= self.upper:
            raise ValueError(
                f"within = [{self.within[0]:g}, {self.within[1]:g}] reaches beyond [lower, upper] ="
                f" [{self.lower:g}, {self.upper:g}]; keep it between them"
            )
