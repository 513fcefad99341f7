"""Distributions between two ends of their own: uniform, triangular, beta."""

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from campaign.inputs.distributions.base import Array, PositiveNumber, check_order, chosen
from campaign.inputs.distributions.continuous import Continuous
from campaign.inputs.distributions.elementary import log
from engine.mechanism.base import Number

Within = Annotated[tuple[Number, Number], Field(strict=False)]


class Bounded(Continuous):
    """A distribution whose ``lower`` and ``upper`` are its own ends, and hold in every production batch.

    Attributes
    ----------
    lower, upper : float
        Its ends.
    """

    lower: Number
    upper: Number

    @property
    def width(self) -> float:
        """Distance of the ends."""
        return self.upper - self.lower

    def parent_support(self) -> tuple[float, float]:
        """Return the ends."""
        return self.lower, self.upper


class Cut(Bounded):
    """A distribution between ends that may be cut further.

    Attributes
    ----------
    within : (float, float) or None
        Bounds between the ends to which it is cut.
    """

    within: Within | None = None

    def cut(self) -> tuple[float, float]:
        """Return the bounds to which it is cut."""
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
    """Every value of [lower, upper] equally likely."""

    distribution: Literal["uniform"]

    def parent_cdf(self, x: Array) -> Array:
        """Return the probability of values up to ``x``."""
        return np.clip((x - self.lower) / self.width, 0.0, 1.0)

    def parent_sf(self, x: Array) -> Array:
        """Return the probability of values above ``x``."""
        return np.clip((self.upper - x) / self.width, 0.0, 1.0)

    def parent_ppf(self, p: Array) -> Array:
        """Return the value with probability ``p`` below it."""
        return np.asarray(self.lower + p * self.width)

    def parent_isf(self, q: Array) -> Array:
        """Return the value with probability ``q`` above it."""
        return np.asarray(self.upper - q * self.width)

    def parent_logpdf(self, x: Array) -> Array:
        """Return the logarithm of the density at ``x``."""
        return np.where((x >= self.lower) & (x <= self.upper), -np.log(self.width), -np.inf)

    def parent_moments(self) -> tuple[float, float]:
        """Return mean and standard deviation."""
        return 0.5 * (self.lower + self.upper), self.width / float(np.sqrt(12.0))

    def words(self) -> str:
        """Return the name."""
        return "uniform"


class Triangular(Cut):
    """Density rising in a straight line from ``lower`` to ``mode`` and falling to ``upper``.

    Attributes
    ----------
    mode : float
        The most likely value.
    """

    distribution: Literal["triangular"]
    mode: Number

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
        """Return the probability of values up to ``x``."""
        return np.where(np.less(x, self.mode), self._corner(x, self.lower, self.rise), 1.0 - self._right(x))

    def parent_sf(self, x: Array) -> Array:
        """Return the probability of values above ``x``."""
        return np.where(np.less(x, self.mode), 1.0 - self._corner(x, self.lower, self.rise), self._right(x))

    def parent_ppf(self, p: Array) -> Array:
        """Return the value with probability ``p`` below it."""
        rising = self.lower + np.sqrt(p * self.width * self.rise)
        falling = self.upper - np.sqrt((1.0 - p) * self.width * self.fall)
        return np.where(p * self.width < self.rise, rising, falling)

    def parent_isf(self, q: Array) -> Array:
        """Return the value with probability ``q`` above it."""
        rising = self.lower + np.sqrt((1.0 - q) * self.width * self.rise)
        falling = self.upper - np.sqrt(q * self.width * self.fall)
        return np.where(q * self.width > self.fall, rising, falling)

    def parent_logpdf(self, x: Array) -> Array:
        """Return the logarithm of the density at ``x``."""
        left, right = (x - self.lower) / (self.rise or 1.0), (self.upper - x) / (self.fall or 1.0)
        height = np.where(x < self.mode, left, np.where((x == self.mode) & (self.fall == 0.0), 1.0, right))
        return log(np.maximum(height, 0.0) * 2.0 / self.width)

    def parent_moments(self) -> tuple[float, float]:
        """Return mean and standard deviation."""
        mean = (self.lower + self.mode + self.upper) / 3.0
        return mean, float(np.sqrt((self.rise**2 + self.rise * self.fall + self.fall**2) / 18.0))

    def words(self) -> str:
        """Return name and parameters."""
        ends = f" of [{self.lower:g}, {self.upper:g}]" if self.within else ""
        return f"triangular{ends}, mode {self.mode:g}"

    def _corner(self, x: Any, end: float, side: float) -> Array:
        """Return the area of the triangle between an end and ``x``, on its side of the mode."""
        distance = np.clip(np.abs(x - end) * (np.sign(x - end) == np.sign(self.mode - end)), 0.0, side)
        return np.asarray(distance * distance / (self.width * (side or 1.0)))

    def _right(self, x: Array) -> Array:
        return self._corner(x, self.upper, self.fall)


class Beta(Cut):
    """Beta distribution stretched to [lower, upper].

    Attributes
    ----------
    alpha, beta : float or None
        Exponents: the density is proportional to (x - lower)^(alpha-1) (upper - x)^(beta-1).
    mean, std : float or None
        Instead: mean and standard deviation, before a cut.
    """

    distribution: Literal["beta"]
    alpha: PositiveNumber | None = None
    beta: PositiveNumber | None = None
    mean: Number | None = None
    std: PositiveNumber | None = None

    def check_parameters(self) -> None:
        """Raise ValueError unless one set of parameters is complete and such a distribution exists."""
        super().check_parameters()
        chosen(self, ("alpha", "beta"), ("mean", "std"))
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
                f"std = {self.std:g}: no distribution of mean {self.mean:g} between {self.lower:g} and {self.upper:g}"
                f" spreads that far; allowed: below {largest:.4g}; reduce std or widen the bounds"
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
        """Return the probability of values up to ``x``."""
        from scipy.special import betainc

        return np.asarray(betainc(*self.exponents, np.clip((x - self.lower) / self.width, 0.0, 1.0)))

    def parent_sf(self, x: Array) -> Array:
        """Return the probability of values above ``x``."""
        from scipy.special import betainc

        alpha, beta = self.exponents
        return np.asarray(betainc(beta, alpha, np.clip((self.upper - x) / self.width, 0.0, 1.0)))

    def parent_ppf(self, p: Array) -> Array:
        """Return the value with probability ``p`` below it."""
        from scipy.special import betaincinv

        return np.asarray(self.lower + self.width * betaincinv(*self.exponents, p))

    def parent_isf(self, q: Array) -> Array:
        """Return the value with probability ``q`` above it."""
        from scipy.special import betaincinv

        alpha, beta = self.exponents
        return np.asarray(self.upper - self.width * betaincinv(beta, alpha, q))

    def parent_logpdf(self, x: Array) -> Array:
        """Return the logarithm of the density at ``x``."""
        from scipy.special import betaln, xlog1py, xlogy

        (alpha, beta), z = self.exponents, np.clip((x - self.lower) / self.width, 0.0, 1.0)
        inside = xlogy(alpha - 1.0, z) + xlog1py(beta - 1.0, -z) - betaln(alpha, beta) - np.log(self.width)
        return np.where((x >= self.lower) & (x <= self.upper), inside, -np.inf)

    def parent_moments(self) -> tuple[float, float]:
        """Return mean and standard deviation."""
        alpha, beta = self.exponents
        total = alpha + beta
        variance = alpha * beta / (total * total * (total + 1.0))
        return self.lower + self.width * alpha / total, self.width * float(np.sqrt(variance))

    def words(self) -> str:
        """Return name and parameters."""
        alpha, beta = self.exponents
        ends = f" of [{self.lower:g}, {self.upper:g}]" if self.within else ""
        return f"beta{ends}, alpha {alpha:g}, beta {beta:g}"
