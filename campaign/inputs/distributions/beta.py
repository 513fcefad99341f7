"""Beta distribution between two ends."""

from typing import Literal

import numpy as np
from pydantic import Field
from scipy.special import betainc, betaincinv, betaln, xlog1py, xlogy

from campaign.inputs.distributions.base import StandardDeviation, check_parameter_groups
from campaign.inputs.distributions.bounded import Cut
from engine.arrays import Array
from engine.mechanism.base import Number, PositiveNumber

LARGEST_EXPONENT = 1e12  # above it, quantiles are no longer in order


class Beta(Cut):
    """Beta distribution: its density is proportional to (x - lower)^(alpha-1) (upper - x)^(beta-1)."""

    distribution: Literal["beta"] = Field(description="Name of the distribution.")
    alpha: PositiveNumber | None = Field(
        default=None, description="Exponent at the lower end, above 0; with beta, instead of mean and std."
    )
    beta: PositiveNumber | None = Field(default=None, description="Exponent at the upper end, above 0.")
    mean: Number | None = Field(
        default=None, description="Mean before any cut, in the target's unit; between lower and upper."
    )
    std: StandardDeviation = None

    def check_parameters(self) -> None:
        """Raise ValueError unless one set of parameters is complete and such a distribution exists."""
        super().check_parameters()
        check_parameter_groups(self, ("alpha", "beta"), ("mean", "std"))
        if max(self.alpha or 0.0, self.beta or 0.0) > LARGEST_EXPONENT:
            raise ValueError(f"alpha and beta: so narrow that digits are lost; allowed: up to {LARGEST_EXPONENT:g}")
        if self.mean is None or self.std is None:
            return
        if not self.lower < self.mean < self.upper:
            raise ValueError(
                f"mean = {self.mean:g} lies outside of (lower, upper) = ({self.lower:g}, {self.upper:g});"
                " move the mean or the bounds"
            )
        largest = float(np.sqrt((self.mean - self.lower) * (self.upper - self.mean)))
        if not self.std < largest:
            raise ValueError(
                f"std = {self.std:g}: too large for mean {self.mean:g} between {self.lower:g} and {self.upper:g}"
                f"; allowed: below {largest:.4g}; reduce std or widen the bounds"
            )

        if not self.std >= self.width / np.sqrt(LARGEST_EXPONENT):
            raise ValueError(
                f"std = {self.std:g}: too small beside upper - lower = {self.width:g}, digits would be lost; allowed:"
                f" from a millionth of it; enlarge std or bring the bounds nearer"
            )

    @property
    def exponents(self) -> tuple[float, float]:
        """Both exponents."""
        if self.alpha is not None and self.beta is not None:
            return self.alpha, self.beta
        mean, std = ((self.mean or 0.0) - self.lower) / self.width, (self.std or 0.0) / self.width
        total = mean * (1.0 - mean) / (std * std) - 1.0
        return mean * total, (1.0 - mean) * total

    def parent_cdf(self, x: Array) -> Array:
        return np.asarray(betainc(*self.exponents, np.clip((x - self.lower) / self.width, 0.0, 1.0)))

    def parent_sf(self, x: Array) -> Array:
        alpha, beta = self.exponents
        return np.asarray(betainc(beta, alpha, np.clip((self.upper - x) / self.width, 0.0, 1.0)))

    def parent_ppf(self, p: Array) -> Array:
        return np.asarray(self.lower + self.width * betaincinv(*self.exponents, p))

    def parent_isf(self, q: Array) -> Array:
        alpha, beta = self.exponents
        return np.asarray(self.upper - self.width * betaincinv(beta, alpha, q))

    def parent_logpdf(self, x: Array) -> Array:
        (alpha, beta), z = self.exponents, np.clip((x - self.lower) / self.width, 0.0, 1.0)
        inside = xlogy(alpha - 1.0, z) + xlog1py(beta - 1.0, -z) - betaln(alpha, beta) - np.log(self.width)
        return np.where((x >= self.lower) & (x <= self.upper), inside, -np.inf)

    def parent_moments(self) -> tuple[float, float]:
        alpha, beta = self.exponents
        total = alpha + beta
        variance = alpha * beta / (total * total * (total + 1.0))
        return self.lower + self.width * alpha / total, self.width * float(np.sqrt(variance))

    def words(self) -> str:
        alpha, beta = self.exponents
        ends = f" of [{self.lower:g}, {self.upper:g}]" if self.within else ""
        return f"beta{ends}, alpha {alpha:g}, beta {beta:g}"
