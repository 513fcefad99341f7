"""The distance of a feature from its true position, within a position zone of a diameter."""

from math import sqrt
from typing import Literal

from pydantic import Field

from campaign.inputs.distributions.base import StandardDeviation
from campaign.inputs.distributions.continuous import Continuous
from engine.mechanism.base import PositiveNumber
from reporting.distributions import forms
from reporting.distributions.forms import ClosedForm


class Position(Continuous):
    """Distance of an axis or a point from its true position in a plane; its direction is a variable of its own."""

    distribution: Literal["position"] = Field(description="Name of the distribution.")
    zone: PositiveNumber = Field(
        description="Diameter of the position zone, in the target's unit, above 0: no distance exceeds half of it, as"
        " parts beyond it are sorted out."
    )
    std: StandardDeviation = Field(
        default=None,
        description="Standard deviation along each of two axes of a process that aims at the true position, above 0:"
        " the distance follows Rayleigh's distribution, cut at the zone. If absent, all places in the zone are equally"
        " likely.",
    )

    def cut(self) -> tuple[float, float]:
        """Return the bounds to which the distribution is cut: the zone too."""
        low, high = super().cut()
        return low, min(high, 0.5 * self.zone)

    def parent(self) -> ClosedForm:
        if self.std is None:
            return forms.triangular(0.0, 0.5 * self.zone, 0.5 * self.zone)
        return forms.weibull(0.0, 2.0, sqrt(2.0) * self.std)  # Rayleigh's

    def words(self) -> str:
        process = "uniform" if self.std is None else f"Rayleigh, sd {self.std:g} along each axis"
        return f"distance in a position zone of diameter {self.zone:g}, {process}"
