"""Distributions of waiting times, and of what else piles up at an origin: Weibull, gamma, exponential."""

from functools import cached_property
from math import exp as exp_of
from math import lgamma
from typing import Literal

import numpy as np

from campaign.inputs.distributions.base import Array, PositiveNumber, chosen
from campaign.inputs.distributions.elementary import exp, log, power
from campaign.inputs.distributions.skewed import Skewed

WEIBULL_SHAPES = (0.2, 1000.0)  # between which a shape is looked for; std / mean is 15.8 and 0.00128 there


class Weibull(Skewed):
    """Weibull distribution: ((value - origin) / scale)^shape is exponential.

    Attributes
    ----------
    shape, scale : float or None
        Its parameters; 63.2 % of the values lie below origin + scale.
    """

    distribution: Literal["weibull"]
    shape: PositiveNumber | None = None
    scale: PositiveNumber | None = None

    def natural(self) -> tuple[str, ...]:
        """Return the keys of shape and scale."""
        return "shape", "scale"

    def check_mean(self) -> None:
        """Raise ValueError unless a Weibull distribution has such a mean and deviation."""
        super().check_mean()
        most, least = (_weibull_variation(shape) for shape in WEIBULL_SHAPES)
        if self.mean is not None and not least < self.variation < most:
            raise ValueError(
                f"std = {self.std:g} is {self.variation:.3g} times the mean above the origin, {self.height:g}; allowed"
                f" for a Weibull distribution: {least:.3g} to {most:.3g} times; change std, mean or origin"
            )

    @cached_property
    def parameters(self) -> tuple[float, float]:
        """Shape and scale; from mean and deviation by bisection, their ratio falls with the shape."""
        if self.shape is not None and self.scale is not None:
            return self.shape, self.scale
        low, high = WEIBULL_SHAPES
        for _ in range(200):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if _weibull_variation(middle) > self.variation else (low, middle)
        return low, self.height / exp_of(lgamma(1.0 + 1.0 / low))

    def _hazard(self, x: Array) -> Array:
        shape, scale = self.parameters
        return power(self.above(x) / scale, shape)

    def parent_cdf(self, x: Array) -> Array:
        """Return the probability of values up to ``x``."""
        from scipy.special import expm1

        return np.asarray(-expm1(-self._hazard(x)))

    def parent_sf(self, x: Array) -> Array:
        """Return the probability of values above ``x``."""
        return exp(-self._hazard(x))

    def parent_ppf(self, p: Array) -> Array:
        """Return the value with probability ``p`` below it."""
        from scipy.special import log1p

        shape, scale = self.parameters
        return self.origin + scale * power(-log1p(-p), 1.0 / shape)

    def parent_isf(self, q: Array) -> Array:
        """Return the value with probability ``q`` above it."""
        shape, scale = self.parameters
        return self.origin + scale * power(-log(q), 1.0 / shape)

    def parent_logpdf(self, x: Array) -> Array:
        """Return the logarithm of the density at ``x``."""
        from scipy.special import xlogy

        shape, scale = self.parameters
        density = xlogy(shape - 1.0, self.above(x) / scale) - self._hazard(x) + np.log(shape / scale)
        return np.where(x >= self.origin, density, -np.inf)

    def parent_moments(self) -> tuple[float, float]:
        """Return mean and standard deviation."""
        shape, scale = self.parameters
        height = scale * exp_of(lgamma(1.0 + 1.0 / shape))
        return self.origin + height, height * _weibull_variation(shape)

    def words(self) -> str:
        """Return name and parameters."""
        shape, scale = self.parameters
        return self.named(f"Weibull, shape {shape:g}, scale {scale:g}")


def _weibull_variation(shape: float) -> float:
    """Return standard deviation divided by mean of a Weibull distribution without origin."""
    return float(np.sqrt(np.expm1(lgamma(1.0 + 2.0 / shape) - 2.0 * lgamma(1.0 + 1.0 / shape))))


class Gamma(Skewed):
    """Gamma distribution.

    Attributes
    ----------
    shape, scale : float or None
        Its parameters: mean - origin = shape * scale, variance = shape * scale^2.
    """

    distribution: Literal["gamma"]
    shape: PositiveNumber | None = None
    scale: PositiveNumber | None = None

    def natural(self) -> tuple[str, ...]:
        """Return the keys of shape and scale."""
        return "shape", "scale"

    @property
    def parameters(self) -> tuple[float, float]:
        """Shape and scale."""
        if self.shape is not None and self.scale is not None:
            return self.shape, self.scale
        return 1.0 / self.variation**2, self.height * self.variation**2

    def parent_cdf(self, x: Array) -> Array:
        """Return the probability of values up to ``x``."""
        from scipy.special import gammainc

        shape, scale = self.parameters
        return np.asarray(gammainc(shape, self.above(x) / scale))

    def parent_sf(self, x: Array) -> Array:
        """Return the probability of values above ``x``."""
        from scipy.special import gammaincc

        shape, scale = self.parameters
        return np.asarray(gammaincc(shape, self.above(x) / scale))

    def parent_ppf(self, p: Array) -> Array:
        """Return the value with probability ``p`` below it."""
        from scipy.special import gammaincinv

        shape, scale = self.parameters
        return np.asarray(self.origin + scale * gammaincinv(shape, p))

    def parent_isf(self, q: Array) -> Array:
        """Return the value with probability ``q`` above it."""
        from scipy.special import gammainccinv

        shape, scale = self.parameters
        return np.asarray(self.origin + scale * gammainccinv(shape, q))

    def parent_logpdf(self, x: Array) -> Array:
        """Return the logarithm of the density at ``x``."""
        from scipy.special import xlogy

        (shape, scale), h = self.parameters, self.above(x)
        density = xlogy(shape - 1.0, h / scale) - h / scale - lgamma(shape) - np.log(scale)
        return np.where(x >= self.origin, density, -np.inf)

    def parent_moments(self) -> tuple[float, float]:
        """Return mean and standard deviation."""
        shape, scale = self.parameters
        return self.origin + shape * scale, float(np.sqrt(shape)) * scale

    def words(self) -> str:
        """Return name and parameters."""
        shape, scale = self.parameters
        return self.named(f"gamma, shape {shape:g}, scale {scale:g}")


class Exponential(Skewed):
    """Exponential distribution: its mean above the origin is its standard deviation and its scale.

    Attributes
    ----------
    scale : float or None
        Instead of the mean, or of the std: mean = origin + scale, std = scale.
    """

    distribution: Literal["exponential"]
    scale: PositiveNumber | None = None

    def natural(self) -> tuple[str, ...]:
        """Return the key of the scale."""
        return ("scale",)

    def check_parameters(self) -> None:
        """Raise ValueError unless exactly one parameter is given."""
        chosen(self, ("scale",), ("mean",), ("std",))
        self.check_mean()

    @property
    def length(self) -> float:
        """The scale."""
        return self.scale or self.std or self.height

    def parent_cdf(self, x: Array) -> Array:
        """Return the probability of values up to ``x``."""
        from scipy.special import expm1

        return np.asarray(-expm1(-self.above(x) / self.length))

    def parent_sf(self, x: Array) -> Array:
        """Return the probability of values above ``x``."""
        return exp(-self.above(x) / self.length)

    def parent_ppf(self, p: Array) -> Array:
        """Return the value with probability ``p`` below it."""
        from scipy.special import log1p

        return np.asarray(self.origin - self.length * log1p(-p))

    def parent_isf(self, q: Array) -> Array:
        """Return the value with probability ``q`` above it."""
        return np.asarray(self.origin - self.length * log(q))

    def parent_logpdf(self, x: Array) -> Array:
        """Return the logarithm of the density at ``x``."""
        return np.where(x >= self.origin, -self.above(x) / self.length - np.log(self.length), -np.inf)

    def parent_moments(self) -> tuple[float, float]:
        """Return mean and standard deviation."""
        return self.origin + self.length, self.length

    def words(self) -> str:
        """Return name and parameters."""
        return self.named(f"exponential, scale {self.length:g}")
