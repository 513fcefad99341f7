"""Distributions of the sampled inputs: one frozen model each, read from ``[variables.NAME]`` of a campaign.

The quantile functions are written from correctly rounded arithmetic and scipy's element-wise special
functions: a value depends on its own uniform number alone, not on how many others are transformed beside it.
"""

from abc import abstractmethod
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

Array = NDArray[np.float64]
Number = Annotated[float, Field(allow_inf_nan=False)]
Spread = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]

TAIL = 1e-6  # probability beyond the ends at which an unbounded variable is tried on the mechanism
LEAST_PROBABILITY = 1e-290  # of a truncation interval: below, its quantiles lose their digits


class Distribution(BaseModel):
    """A random input of the mechanism.

    Attributes
    ----------
    target : str or None
        Key of the mechanism it sets; None means the variable's own name.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    target: Annotated[str | None, Field(min_length=1)] = None

    @abstractmethod
    def ppf(self, u: Array) -> Array:
        """Return the quantiles at probabilities ``u``, each in (0, 1); same shape, in the target's unit."""

    @abstractmethod
    def cdf(self, x: Array) -> Array:
        """Return the probability of values up to ``x``; same shape."""

    @abstractmethod
    def support(self) -> tuple[float, float]:
        """Return the ends between which every value lies; infinite where there is no end."""

    @abstractmethod
    def moments(self) -> tuple[float, float]:
        """Return mean and standard deviation of what is drawn (truncation included)."""

    @abstractmethod
    def density_points(self, count: int = 101) -> tuple[tuple[float, float], ...]:
        """Return ``count`` points (x, density) between the ends, for drawing; none if there is no density."""

    @abstractmethod
    def text(self) -> str:
        """Return the distribution in words and numbers, without unit."""

    def ends(self) -> tuple[float, float]:
        """Return the support, an infinite end replaced by the quantile with probability 1e-6 beyond it."""
        low, high = self.support()
        tails = self.ppf(np.array([TAIL, 1.0 - TAIL]))
        return (low if np.isfinite(low) else float(tails[0])), (high if np.isfinite(high) else float(tails[1]))


class Continuous(Distribution):
    """A distribution with a density; scipy knows everything about it but the quantiles (see above)."""

    @abstractmethod
    def frozen(self) -> Any:
        """Return the same distribution as a frozen scipy one."""

    def cdf(self, x: Array) -> Array:
        """Return the probability of values up to ``x``; same shape."""
        return np.asarray(self.frozen().cdf(x), dtype=np.float64)

    def support(self) -> tuple[float, float]:
        """Return the ends between which every value lies; infinite where there is no end."""
        low, high = self.frozen().support()
        return float(low), float(high)

    def moments(self) -> tuple[float, float]:
        """Return mean and standard deviation of what is drawn (truncation included)."""
        mean, variance = self.frozen().stats(moments="mv")
        return float(mean), float(np.sqrt(variance))

    def density_points(self, count: int = 101) -> tuple[tuple[float, float], ...]:
        """Return ``count`` points (x, density) between the ends, for drawing."""
        x = np.linspace(*self.ends(), count)
        return tuple(zip(x.tolist(), self.frozen().pdf(x).tolist(), strict=True))


class Normal(Continuous):
    """Normal distribution of given mean and standard deviation."""

    distribution: Literal["normal"]
    mean: Number
    std: Spread

    def ppf(self, u: Array) -> Array:
        """Return the quantiles at probabilities ``u``."""
        from scipy.special import ndtri

        return np.asarray(self.mean + self.std * ndtri(u), dtype=np.float64)

    def frozen(self) -> Any:
        """Return ``scipy.stats.norm``."""
        from scipy.stats import norm

        return norm(self.mean, self.std)

    def text(self) -> str:
        """Return the distribution in words and numbers."""
        return f"normal, mean {self.mean:g}, sd {self.std:g}"


class TruncatedNormal(Continuous):
    """Normal distribution cut to [lower, upper]; ``mean`` and ``std`` are those before the cut."""

    distribution: Literal["truncated_normal"]
    mean: Number
    std: Spread
    lower: Number
    upper: Number

    @model_validator(mode="after")
    def _interval_holds_probability(self) -> Self:
        _ordered(self.lower, self.upper)
        low, _, probability = self._lower_half()
        if probability < LEAST_PROBABILITY:
            raise ValueError(
                f"[{self.lower:g}, {self.upper:g}] begins {abs(low):.3g} standard deviations from the mean"
                f" {self.mean:g}: nothing can be drawn there; move the bounds or the mean, or enlarge std"
            )
        return self

    def _lower_half(self) -> tuple[float, float, float]:
        """Return the standardised bounds, mirrored below zero when both are above, and the probability."""
        from scipy.special import ndtr

        low, high = (self.lower - self.mean) / self.std, (self.upper - self.mean) / self.std
        if low > 0.0:
            low, high = -high, -low
        return low, high, float(ndtr(high) - ndtr(low))

    def ppf(self, u: Array) -> Array:
        """Return the quantiles at probabilities ``u``; an upper tail is mirrored to keep its digits."""
        from scipy.special import ndtr, ndtri

        low, _, probability = self._lower_half()
        mirrored = self.lower > self.mean
        z = ndtri(ndtr(low) + (1.0 - u if mirrored else u) * probability)
        x = self.mean + self.std * (-z if mirrored else z)
        return np.clip(np.asarray(x, dtype=np.float64), self.lower, self.upper)

    def frozen(self) -> Any:
        """Return ``scipy.stats.truncnorm``."""
        from scipy.stats import truncnorm

        low, high = (self.lower - self.mean) / self.std, (self.upper - self.mean) / self.std
        return truncnorm(low, high, loc=self.mean, scale=self.std)

    def support(self) -> tuple[float, float]:
        """Return the bounds as written."""
        return self.lower, self.upper

    def text(self) -> str:
        """Return the distribution in words and numbers."""
        ends = f"between {self.lower:g} and {self.upper:g}"
        return f"truncated normal, mean {self.mean:g}, sd {self.std:g}, {ends}"


class Uniform(Continuous):
    """Every value of [lower, upper] equally likely."""

    distribution: Literal["uniform"]
    lower: Number
    upper: Number

    @model_validator(mode="after")
    def _bounds(self) -> Self:
        _ordered(self.lower, self.upper)
        return self

    def ppf(self, u: Array) -> Array:
        """Return the quantiles at probabilities ``u``."""
        return np.clip(self.lower + u * (self.upper - self.lower), self.lower, self.upper)

    def frozen(self) -> Any:
        """Return ``scipy.stats.uniform``."""
        from scipy.stats import uniform

        return uniform(self.lower, self.upper - self.lower)

    def text(self) -> str:
        """Return the distribution in words and numbers."""
        return f"uniform between {self.lower:g} and {self.upper:g}"


class Triangular(Continuous):
    """Density rising in a straight line from ``lower`` to ``mode`` and falling to ``upper``."""

    distribution: Literal["triangular"]
    lower: Number
    mode: Number
    upper: Number

    @model_validator(mode="after")
    def _bounds(self) -> Self:
        _ordered(self.lower, self.upper)
        if not self.lower <= self.mode <= self.upper:
            raise ValueError(
                f"mode = {self.mode:g} lies outside [lower, upper] = [{self.lower:g}, {self.upper:g}];"
                " move the mode or the bounds"
            )
        return self

    def ppf(self, u: Array) -> Array:
        """Return the quantiles at probabilities ``u``."""
        width, rise, fall = self.upper - self.lower, self.mode - self.lower, self.upper - self.mode
        rising = self.lower + np.sqrt(u * width * rise)
        falling = self.upper - np.sqrt((1.0 - u) * width * fall)
        return np.clip(np.where(u * width < rise, rising, falling), self.lower, self.upper)

    def frozen(self) -> Any:
        """Return ``scipy.stats.triang``."""
        from scipy.stats import triang

        width = self.upper - self.lower
        return triang((self.mode - self.lower) / width, self.lower, width)

    def text(self) -> str:
        """Return the distribution in words and numbers."""
        return f"triangular between {self.lower:g} and {self.upper:g}, mode {self.mode:g}"


class Constant(Distribution):
    """One fixed value: sets a target for the whole campaign and documents it as an input."""

    distribution: Literal["constant"]
    value: Number

    def ppf(self, u: Array) -> Array:
        """Return the value, in the shape of ``u``."""
        return np.full_like(u, self.value)

    def support(self) -> tuple[float, float]:
        """Return the value twice."""
        return self.value, self.value

    def moments(self) -> tuple[float, float]:
        """Return the value and zero."""
        return self.value, 0.0

    def cdf(self, x: Array) -> Array:
        """Return 0 below the value, 1 from it on."""
        return np.asarray(x >= self.value, dtype=np.float64)

    def density_points(self, count: int = 101) -> tuple[tuple[float, float], ...]:
        """Return nothing: a constant has no density."""
        return ()

    def text(self) -> str:
        """Return the distribution in words and numbers."""
        return f"constant {self.value:g}"


Variable = Annotated[TruncatedNormal | Normal | Uniform | Triangular | Constant, Field(discriminator="distribution")]


def _ordered(lower: float, upper: float) -> None:
    if not lower < upper:
        raise ValueError(f"lower = {lower:g} is not below upper = {upper:g}; exchange or widen the bounds")
