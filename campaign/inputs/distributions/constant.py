"""A constant."""

from math import inf
from typing import Literal

import numpy as np
from pydantic import Field

from campaign.inputs.distributions.base import Distribution
from engine.arrays import Array
from engine.mechanism.base import Number


class Constant(Distribution):
    """One fixed value: sets a target for the whole campaign and documents it as an input."""

    distribution: Literal["constant"] = Field(description="Name of the distribution.")
    value: Number = Field(description="The value, in the target's unit.")

    def ppf(self, u: Array) -> Array:
        return np.full_like(u, self.value)

    def support(self) -> tuple[float, float]:
        return self.value, self.value

    def moments(self) -> tuple[float, float]:
        return self.value, 0.0

    def cdf(self, x: Array) -> Array:
        return np.asarray(x >= self.value, dtype=np.float64)

    def logpdf(self, x: Array) -> Array:
        return np.where(x == self.value, 0.0, -inf)

    def text(self) -> str:
        return f"constant {self.value:g}"
