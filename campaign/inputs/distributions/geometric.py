"""Geometric distribution of a count."""

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from campaign.inputs.distributions.discrete import Count
from campaign.inputs.distributions.elementary import exp
from engine.arrays import Array

LEAST_PROBABILITY = 1e-4


class Geometric(Count):
    """Geometric distribution of a count k = 1, 2, 3, ...: number of trials up to the first success."""

    least: ClassVar[int] = 1

    distribution: Literal["geometric"] = Field(description="Name of the distribution.")
    probability: Annotated[float, Field(ge=LEAST_PROBABILITY, lt=1.0)] = Field(
        description="Probability of success in one trial, from 1e-4, below 1."
    )

    def outcomes(self) -> tuple[Array, Array]:
        """Return values and probabilities; counts less likely than 1e-26 are left out."""
        first, last = self.counts()
        # (1 - p)^(60 / p) is below exp(-60), which is 1e-26
        k = np.arange(first, int(min(last, first + 60.0 / self.probability + 1.0)) + 1)
        return self.scaled(k), exp((k - first) * float(np.log1p(-self.probability)))

    def text(self) -> str:
        return f"geometric, probability {self.probability:g}, {self.origin:g} + {self.step:g} k{self.between()}"
