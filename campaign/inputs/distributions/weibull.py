"""Weibull distribution."""

from functools import cached_property
from math import exp as exp_of
from math import lgamma
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field
from scipy.special import expm1, log1p, xlogy

from campaign.inputs.distributions.elementary import exp, log, power
from campaign.inputs.distributions.skewed import Skewed
from engine.arrays import Array
from engine.mechanism.base import PositiveNumber

LARGE = 1e4
ZETA = (1.6449340668482264, 1.2020569031595942, 1.0823232337111382)  # zeta(2), zeta(3), zeta(4)
SHAPES = (0.2, 1000.0)  # range of shapes that mean and std can give; at its ends std / mean is 15.8 and 0.00128


class Weibull(Skewed):
    """Weibull distribution: ((value - origin) / scale)^shape is exponential."""

    natural_keys: ClassVar[tuple[str, ...]] = ("shape", "scale")

    distribution: Literal["weibull"] = Field(description="Name of the distribution.")
    shape: PositiveNumber | None = Field(
        default=None, description="Exponent of the distribution, above 0; with scale, instead of mean and std."
    )
    scale: PositiveNumber | None = Field(
        default=None, description="Scale in the target's unit, above 0: 63.2 % of the values lie below origin + scale."
    )

    def check_mean(self) -> None:
        """Raise ValueError unless a Weibull distribution with this mean and standard deviation exists."""
        super().check_mean()
        most, least = (_variation(shape) for shape in SHAPES)
        if self.mean is not None and not least < self.variation < most:
            raise ValueError(
                f"std = {self.std:g} is {self.variation:.3g} times the mean above the origin, {self.height:g}; allowed"
                f" for a Weibull distribution: {least:.3g} to {most:.3g} times; change std, mean or origin"
            )

    @cached_property
    def parameters(self) -> tuple[float, float]:
        """Shape and scale; if mean and std are given, found by bisection, since std / mean falls with the shape."""
        if self.shape is not None and self.scale is not None:
            return self.shape, self.scale
        low, high = SHAPES
        # more halvings than a double has digits: it ends at two neighbouring numbers
        for _ in range(200):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if _variation(middle) > self.variation else (low, middle)
        return low, self.height / exp_of(lgamma(1.0 + 1.0 / low))

    def _hazard(self, x: Array) -> Array:
        shape, scale = self.parameters
        return power(self.above(x) / scale, shape)

    def parent_cdf(self, x: Array) -> Array:
        return np.asarray(-expm1(-self._hazard(x)))

    def parent_sf(self, x: Array) -> Array:
        return exp(-self._hazard(x))

    def parent_ppf(self, p: Array) -> Array:
        shape, scale = self.parameters
        return self.origin + scale * power(-log1p(-p), 1.0 / shape)

    def parent_isf(self, q: Array) -> Array:
        shape, scale = self.parameters
        return self.origin + scale * power(-log(q), 1.0 / shape)

    def parent_logpdf(self, x: Array) -> Array:
        shape, scale = self.parameters
        density = xlogy(shape - 1.0, self.above(x) / scale) - self._hazard(x) + np.log(shape / scale)
        return np.where(x >= self.origin, density, -np.inf)

    def parent_moments(self) -> tuple[float, float]:
        shape, scale = self.parameters
        height = scale * exp_of(lgamma(1.0 + 1.0 / shape))
        return self.origin + height, height * _variation(shape)

    def words(self) -> str:
        if self.mean is not None:
            return self.named(f"Weibull, mean {self.mean:g}, sd {self.std:g}")
        shape, scale = self.parameters
        return self.named(f"Weibull, shape {shape:g}, scale {scale:g}")


def _variation(shape: float) -> float:
    """Return the standard deviation divided by the mean of a Weibull distribution whose origin is 0."""
    if shape > LARGE:  # the difference below would lose digits: use the series of log gamma at 1
        x = 1.0 / shape
        return float(np.sqrt(np.expm1(x * x * (ZETA[0] - 2.0 * ZETA[1] * x + 3.5 * ZETA[2] * x * x))))
    return float(np.sqrt(np.expm1(lgamma(1.0 + 2.0 / shape) - 2.0 * lgamma(1.0 + 1.0 / shape))))
