"""Poisson distribution of a count."""

from math import lgamma, sqrt
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from campaign.inputs.distributions.discrete import Count
from campaign.inputs.distributions.elementary import exp, log
from engine.arrays import Array

LARGEST_RATE = 1e8


class Poisson(Count):
    """Poisson distribution of a count k = 0, 1, 2, ..."""

    least: ClassVar[int] = 0

    distribution: Literal["poisson"] = Field(description="Name of the distribution.")
    rate: Annotated[float, Field(gt=0.0, le=LARGEST_RATE)] = Field(
        description="Mean of the count before any cut, above 0, at most 1e8."
    )

    def outcomes(self) -> tuple[Array, Array]:
        """Return values and probabilities; counts less likely than 1e-25 are left out."""
        first, last = self.counts()
        reach, mode = int(12.0 * sqrt(self.rate)) + 60, int(self.rate)
        begin = max(first, int(min(last, mode)) - reach)
        k = np.arange(begin, int(min(last, max(first, mode) + reach)) + 1)
        logarithm = k * float(log(self.rate)) - np.array([lgamma(i + 1.0) for i in k.tolist()])
        return self.scaled(k), exp(logarithm - logarithm.max())

    def text(self) -> str:
        return f"Poisson, mean count {self.rate:g}, {self.origin:g} + {self.step:g} k{self.between()}"
