"""Exponential distribution."""

from typing import Literal

import numpy as np
from pydantic import Field
from scipy.special import expm1, log1p

from campaign.inputs.distributions.base import check_parameter_groups
from campaign.inputs.distributions.elementary import exp, log
from campaign.inputs.distributions.skewed import Skewed
from engine.arrays import Array
from engine.mechanism.base import PositiveNumber


class Exponential(Skewed):
    """Exponential distribution: its standard deviation and its mean above the origin both equal its scale."""

    distribution: Literal["exponential"] = Field(description="Name of the distribution.")
    scale: PositiveNumber | None = Field(
        default=None,
        description="Scale in the target's unit, above 0, instead of mean or std: mean = origin + scale, std = scale.",
    )

    def check_parameters(self) -> None:
        """Raise ValueError unless exactly one parameter is given."""
        check_parameter_groups(self, ("scale",), ("mean",), ("std",))
        self.check_mean()

    @property
    def length(self) -> float:
        """The scale."""
        return self.scale or self.std or self.height

    def parent_cdf(self, x: Array) -> Array:
        return np.asarray(-expm1(-self.above(x) / self.length))

    def parent_sf(self, x: Array) -> Array:
        return exp(-self.above(x) / self.length)

    def parent_ppf(self, p: Array) -> Array:
        return np.asarray(self.origin - self.length * log1p(-p))

    def parent_isf(self, q: Array) -> Array:
        return np.asarray(self.origin - self.length * log(q))

    def parent_logpdf(self, x: Array) -> Array:
        return np.where(x >= self.origin, -self.above(x) / self.length - np.log(self.length), -np.inf)

    def parent_moments(self) -> tuple[float, float]:
        return self.origin + self.length, self.length

    def words(self) -> str:
        return self.named(f"exponential, scale {self.length:g}")
