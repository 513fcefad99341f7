"""Lognormal distribution."""

from functools import cached_property
from math import exp as exp_of
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field
from scipy.special import ndtr, ndtri

from campaign.inputs.distributions.elementary import HALF_LOG_TWO_PI, exp, log
from campaign.inputs.distributions.skewed import Skewed
from engine.arrays import Array
from engine.mechanism.base import Number, PositiveNumber


class Lognormal(Skewed):
    """Lognormal distribution: the logarithm of (value - origin) is normal."""

    natural_keys: ClassVar[tuple[str, ...]] = ("log_mean", "log_std")

    distribution: Literal["lognormal"] = Field(description="Name of the distribution.")
    log_mean: Number | None = Field(
        default=None,
        description="Mean of the natural logarithm of (value - origin); with log_std, instead of mean and std.",
    )
    log_std: PositiveNumber | None = Field(
        default=None, description="Standard deviation of the natural logarithm of (value - origin), above 0."
    )

    @cached_property
    def logarithm(self) -> tuple[float, float]:
        """Mean and standard deviation of the logarithm."""
        if self.log_mean is not None and self.log_std is not None:
            return self.log_mean, self.log_std
        variance = float(np.log1p(self.variation**2))
        return float(np.log(self.height)) - 0.5 * variance, float(np.sqrt(variance))

    def _score(self, x: Array) -> Array:
        mean, std = self.logarithm
        return np.asarray((log(self.above(x)) - mean) / std)

    def parent_cdf(self, x: Array) -> Array:
        return np.asarray(ndtr(self._score(x)))

    def parent_sf(self, x: Array) -> Array:
        return np.asarray(ndtr(-self._score(x)))

    def parent_ppf(self, p: Array) -> Array:
        mean, std = self.logarithm
        return self.origin + exp(mean + std * ndtri(p))

    def parent_isf(self, q: Array) -> Array:
        mean, std = self.logarithm
        return self.origin + exp(mean - std * ndtri(q))

    def parent_logpdf(self, x: Array) -> Array:
        h = self.above(x)
        # below the origin, where the density is replaced, any number that has a logarithm
        z = self._score(np.where(h > 0.0, x, self.origin + 1.0))
        density = -0.5 * z * z - HALF_LOG_TWO_PI - np.log(self.logarithm[1]) - log(np.where(h > 0.0, h, 1.0))
        return np.where(h > 0.0, density, -np.inf)

    def parent_moments(self) -> tuple[float, float]:
        mean, std = self.logarithm
        height = exp_of(mean + 0.5 * std * std)
        return self.origin + height, height * float(np.sqrt(np.expm1(std * std)))

    def words(self) -> str:
        if self.mean is not None:
            return self.named(f"lognormal, mean {self.mean:g}, sd {self.std:g}")
        mean, std = self.logarithm
        return self.named(f"lognormal, mean {mean:g} and sd {std:g} of the logarithm")
