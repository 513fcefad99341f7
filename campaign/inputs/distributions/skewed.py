"""Distributions above an origin with a tail to the right, and the lognormal one of them."""

from abc import abstractmethod
from functools import cached_property
from math import exp as exp_of
from typing import Literal

import numpy as np

from campaign.inputs.distributions.base import Array, PositiveNumber, chosen
from campaign.inputs.distributions.continuous import Continuous
from campaign.inputs.distributions.elementary import exp, log
from campaign.inputs.distributions.normal import HALF_LOG_TWO_PI
from engine.mechanism.base import Number


class Skewed(Continuous):
    """A distribution of values above an origin.

    Attributes
    ----------
    origin : float
        The lowest possible value.
    mean, std : float or None
        Mean and standard deviation of the value, origin included, before a cut.
    """

    origin: Number = 0.0
    mean: Number | None = None
    std: PositiveNumber | None = None

    @abstractmethod
    def natural(self) -> tuple[str, ...]:
        """Return the keys that are given instead of mean and std."""

    def check_parameters(self) -> None:
        """Raise ValueError unless one set of parameters is complete and such a distribution exists."""
        chosen(self, self.natural(), ("mean", "std"))
        self.check_mean()

    def check_mean(self) -> None:
        """Raise ValueError unless the mean lies above the origin."""
        if self.mean is not None and not self.mean > self.origin:
            raise ValueError(
                f"mean = {self.mean:g} is not above origin = {self.origin:g}, below which there is no value;"
                " raise the mean or lower the origin"
            )

    @property
    def height(self) -> float:
        """The mean above the origin, where it is given."""
        return (self.mean or 0.0) - self.origin

    @property
    def variation(self) -> float:
        """Standard deviation divided by the mean above the origin, where they are given."""
        return (self.std or 0.0) / self.height

    def above(self, x: Array) -> Array:
        """Return the distance of ``x`` above the origin, 0 below it."""
        return np.maximum(x - self.origin, 0.0)

    def parent_support(self) -> tuple[float, float]:
        """Return the origin and infinity."""
        return self.origin, np.inf

    def named(self, parameters: str) -> str:
        """Return name and parameters, with the origin if it is not 0."""
        return f"{parameters}, origin {self.origin:g}" if self.origin else parameters


class Lognormal(Skewed):
    """The logarithm of the value, less the origin, is normal.

    Attributes
    ----------
    log_mean, log_std : float or None
        Mean and standard deviation of the natural logarithm of (value - origin).
    """

    distribution: Literal["lognormal"]
    log_mean: Number | None = None
    log_std: PositiveNumber | None = None

    def natural(self) -> tuple[str, ...]:
        """Return the keys of the logarithm."""
        return "log_mean", "log_std"

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
        """Return the probability of values up to ``x``."""
        from scipy.special import ndtr

        return np.asarray(ndtr(self._score(x)))

    def parent_sf(self, x: Array) -> Array:
        """Return the probability of values above ``x``."""
        from scipy.special import ndtr

        return np.asarray(ndtr(-self._score(x)))

    def parent_ppf(self, p: Array) -> Array:
        """Return the value with probability ``p`` below it."""
        from scipy.special import ndtri

        mean, std = self.logarithm
        return self.origin + exp(mean + std * ndtri(p))

    def parent_isf(self, q: Array) -> Array:
        """Return the value with probability ``q`` above it."""
        from scipy.special import ndtri

        mean, std = self.logarithm
        return self.origin + exp(mean - std * ndtri(q))

    def parent_logpdf(self, x: Array) -> Array:
        """Return the logarithm of the density at ``x``."""
        h = self.above(x)
        z = self._score(np.where(h > 0.0, x, self.origin + 1.0))
        density = -0.5 * z * z - HALF_LOG_TWO_PI - np.log(self.logarithm[1]) - log(np.where(h > 0.0, h, 1.0))
        return np.where(h > 0.0, density, -np.inf)

    def parent_moments(self) -> tuple[float, float]:
        """Return mean and standard deviation."""
        mean, std = self.logarithm
        height = exp_of(mean + 0.5 * std * std)
        return self.origin + height, height * float(np.sqrt(np.expm1(std * std)))

    def words(self) -> str:
        """Return name and parameters."""
        mean, std = self.logarithm
        return self.named(f"lognormal, mean {mean:g} and sd {std:g} of the logarithm")
