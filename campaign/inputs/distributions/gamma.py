"""Gamma distribution."""

from math import lgamma
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field
from scipy.special import gammainc, gammaincc, gammainccinv, gammaincinv, xlogy

from campaign.inputs.distributions.skewed import Skewed
from engine.arrays import Array
from engine.mechanism.base import PositiveNumber


class Gamma(Skewed):
    """Gamma distribution above an origin."""

    natural_keys: ClassVar[tuple[str, ...]] = ("shape", "scale")

    distribution: Literal["gamma"] = Field(description="Name of the distribution.")
    shape: PositiveNumber | None = Field(
        default=None,
        description="Shape, above 0; with scale, instead of mean and std: mean = origin + shape * scale.",
    )
    scale: PositiveNumber | None = Field(
        default=None, description="Scale in the target's unit, above 0: variance = shape * scale^2."
    )

    @property
    def parameters(self) -> tuple[float, float]:
        """Shape and scale."""
        if self.shape is not None and self.scale is not None:
            return self.shape, self.scale
        return 1.0 / self.variation**2, self.height * self.variation**2

    def parent_cdf(self, x: Array) -> Array:
        shape, scale = self.parameters
        return np.asarray(gammainc(shape, self.above(x) / scale))

    def parent_sf(self, x: Array) -> Array:
        shape, scale = self.parameters
        return np.asarray(gammaincc(shape, self.above(x) / scale))

    def parent_ppf(self, p: Array) -> Array:
        shape, scale = self.parameters
        return np.asarray(self.origin + scale * gammaincinv(shape, p))

    def parent_isf(self, q: Array) -> Array:
        shape, scale = self.parameters
        return np.asarray(self.origin + scale * gammainccinv(shape, q))

    def parent_logpdf(self, x: Array) -> Array:
        (shape, scale), h = self.parameters, self.above(x)
        density = xlogy(shape - 1.0, h / scale) - h / scale - lgamma(shape) - np.log(scale)
        return np.where(x >= self.origin, density, -np.inf)

    def parent_moments(self) -> tuple[float, float]:
        shape, scale = self.parameters
        return self.origin + shape * scale, float(np.sqrt(shape)) * scale

    def words(self) -> str:
        if self.mean is not None:
            return self.named(f"gamma, mean {self.mean:g}, sd {self.std:g}")
        shape, scale = self.parameters
        return self.named(f"gamma, shape {shape:g}, scale {scale:g}")
