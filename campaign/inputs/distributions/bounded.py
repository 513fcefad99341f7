"""Distributions whose definition includes two ends: uniform, triangular, beta."""

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field
from scipy.special import betainc, betaincinv, betaln, xlog1py, xlogy

from campaign.inputs.distributions.base import StandardDeviation, check_order, check_parameter_groups, log
from campaign.inputs.distributions.continuous import Continuous
from engine.arrays import Array
from engine.mechanism.base import Number, PositiveNumber

Within = Annotated[tuple[Number, Number], Field(strict=False)]

LARGEST_EXPONENT = 1e12  # above it, quantiles are no longer in order


class Bounded(Continuous):
    """A distribution whose ``lower`` and ``upper`` are part of its definition; they hold in every production batch."""

    lower: Number = Field(description="Lower end of the distribution, in the target's unit; below the upper end.")
    upper: Number = Field(description="Upper end of the distribution, in the target's unit; above the lower end.")

    @property
    def width(self) -> float:
        """Distance between the ends."""
        return self.upper - self.lower

    def parent_support(self) -> tuple[float, float]:
        return self.lower, self.upper


class Cut(Bounded):
    """A distribution between two ends that may be cut further."""

    within: Within | None = Field(
        default=None,
        description="Bounds [low, high] between the ends at which the distribution is cut, in the target's unit.",
    )

    def cut(self) -> tuple[float, float]:
        """Return the bounds to which the distribution is cut."""
        return self.within or (self.lower, self.upper)

    def check_parameters(self) -> None:
        """Raise ValueError unless ``within`` lies between the ends."""
        if self.within is None:
            return
        check_order(*self.within)
        if not self.lower <= self.within[0] or not self.within[1] <= self.upper:
            raise ValueError(
                f"within = [{self.within[0]:g}, {self.within[1]:g}] reaches beyond [lower, upper] ="
                f" [{self.lower:g}, {self.upper:g}]; keep it between them"
            )


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


class Triangular(Cut):
    """Triangular distribution: the density rises in a straight line from lower to mode and falls to upper."""

    distribution: Literal["triangular"] = Field(description="Name of the distribution.")
    mode: Number = Field(description="Most likely value, in the target's unit, from lower to upper.")

    def check_parameters(self) -> None:
        """Raise ValueError unless the mode lies between the ends."""
        super().check_parameters()
        if not self.lower <= self.mode <= self.upper:
            raise ValueError(
                f"mode = {self.mode:g} lies outside [lower, upper] = [{self.lower:g}, {self.upper:g}];"
                " move the mode or the bounds"
            )

    @property
    def rise(self) -> float:
        """Distance from the lower end to the mode."""
        return self.mode - self.lower

    @property
    def fall(self) -> float:
        """Distance from the mode to the upper end."""
        return self.upper - self.mode

    def parent_cdf(self, x: Array) -> Array:
        return np.where(np.less(x, self.mode), self._corner(x, self.lower, self.rise), 1.0 - self._right(x))

    def parent_sf(self, x: Array) -> Array:
        return np.where(np.less(x, self.mode), 1.0 - self._corner(x, self.lower, self.rise), self._right(x))

    def parent_ppf(self, p: Array) -> Array:
        rising = self.lower + np.sqrt(p * self.width * self.rise)
        falling = self.upper - np.sqrt((1.0 - p) * self.width * self.fall)
        return np.where(p * self.width < self.rise, rising, falling)

    def parent_isf(self, q: Array) -> Array:
        rising = self.lower + np.sqrt((1.0 - q) * self.width * self.rise)
        falling = self.upper - np.sqrt(q * self.width * self.fall)
        return np.where(q * self.width > self.fall, rising, falling)

    def parent_logpdf(self, x: Array) -> Array:
        # a mode at an end leaves a side without width: nothing lies there, and 1 avoids a division by 0
        left, right = (x - self.lower) / (self.rise or 1.0), (self.upper - x) / (self.fall or 1.0)
        height = np.where(x < self.mode, left, np.where((x == self.mode) & (self.fall == 0.0), 1.0, right))
        return log(np.maximum(height, 0.0) * 2.0 / self.width)

    def parent_moments(self) -> tuple[float, float]:
        mean = (self.lower + self.mode + self.upper) / 3.0
        return mean, float(np.sqrt((self.rise**2 + self.rise * self.fall + self.fall**2) / 18.0))

    def words(self) -> str:
        ends = f" of [{self.lower:g}, {self.upper:g}]" if self.within else ""
        return f"triangular{ends}, mode {self.mode:g}"

    def _corner(self, x: Any, end: float, side: float) -> Array:
        """Return the area of the triangle between an end and ``x``, on its side of the mode."""
        distance = np.clip(np.abs(x - end) * (np.sign(x - end) == np.sign(self.mode - end)), 0.0, side)
        return np.asarray(distance * distance / (self.width * (side or 1.0)))

    def _right(self, x: Array) -> Array:
        return self._corner(x, self.upper, self.fall)


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
