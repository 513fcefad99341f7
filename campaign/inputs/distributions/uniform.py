"""Uniform distribution."""

from typing import Literal

import numpy as np
from pydantic import Field

from campaign.inputs.distributions.bounded import Bounded
from engine.arrays import Array


class Uniform(Bounded):
    """Uniform distribution: every value of [lower, upper] is equally likely."""

    distribution: Literal["uniform"] = Field(description="Name of the distribution.")

    def parent_cdf(self, x: Array) -> Array:
        return np.clip((x - self.lower) / self.width, 0.0, 1.0)

    def parent_sf(self, x: Array) -> Array:
        return np.clip((self.upper - x) / self.width, 0.0, 1.0)

    def parent_ppf(self, p: Array) -> Array:
        return np.asarray(self.lower + p * self.width)

    def parent_isf(self, q: Array) -> Array:
        return np.asarray(self.upper - q * self.width)

    def parent_logpdf(self, x: Array) -> Array:
        return np.where((x >= self.lower) & (x <= self.upper), -np.log(self.width), -np.inf)

    def parent_moments(self) -> tuple[float, float]:
        return 0.5 * (self.lower + self.upper), self.width / float(np.sqrt(12.0))

    def words(self) -> str:
        return "uniform"
