"""Distributions of separate values, drawn from a table of values and probabilities: any cut keeps its digits."""

from abc import abstractmethod
from functools import cached_property
from math import inf, isfinite, lgamma, sqrt
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from campaign.inputs.distributions.base import Array, Distribution, PositiveNumber, check_order
from campaign.inputs.distributions.elementary import exp, log
from engine.mechanism.base import Number

LARGEST_RATE = 1e8  # of a Poisson distribution
LEAST_CHANCE = 1e-4  # of a geometric distribution
ROUNDING = 1e-9  # of a step: a bound on a value keeps it


class Discrete(Distribution):
    """A distribution of separate values.

    Attributes
    ----------
    lower, upper : float or None
        Bounds to which it is cut.
    """

    lower: Number | None = None
    upper: Number | None = None

    @abstractmethod
    def outcomes(self) -> tuple[Array, Array]:
        """Return the values within the bounds, ascending, and their probabilities, both of shape (k,)."""

    def check_parameters(self) -> None:
        """Raise ValueError if the parameters contradict each other."""

    def bounds(self) -> tuple[float, float]:
        """Return the bounds; infinite where there is none."""
        return (-inf if self.lower is None else self.lower), (inf if self.upper is None else self.upper)

    @model_validator(mode="after")
    def _can_be_drawn(self) -> Self:
        if self.lower is not None and self.upper is not None and self.lower != self.upper:
            check_order(self.lower, self.upper)
        self.check_parameters()
        return self

    @cached_property
    def _table(self) -> tuple[Array, Array, Array]:
        """Values, their probabilities, and the probabilities of values up to each; each of shape (k,)."""
        values, shares = self.outcomes()
        total = np.cumsum(shares)
        return values, shares / total[-1], total / total[-1]

    def ppf(self, u: Array) -> Array:
        """Return the quantiles at probabilities ``u``."""
        values, _, total = self._table
        return values[np.minimum(np.searchsorted(total, u), values.size - 1)]

    def cdf(self, x: Array) -> Array:
        """Return the probability of values up to ``x``."""
        values, _, total = self._table
        return np.append(0.0, total)[np.searchsorted(values, x, side="right")]

    def logpdf(self, x: Array) -> Array:
        """Return the logarithm of the probability of ``x``; minus infinity for what is never drawn."""
        values, shares, _ = self._table
        x = np.asarray(x, dtype=np.float64)
        at = np.minimum(np.searchsorted(values, x), values.size - 1)
        return np.where(values[at] == x, log(shares)[at], -inf)

    def moments(self) -> tuple[float, float]:
        """Return mean and standard deviation of what is drawn (truncation included)."""
        values, shares, _ = self._table
        mean = float(shares @ values)
        return mean, sqrt(float(shares @ (values - mean) ** 2))

    def support(self) -> tuple[float, float]:
        """Return the ends between which every value lies; infinite where there is no end."""
        values = self._table[0]
        return float(values[0]), float(values[-1])

    def between(self) -> str:
        """Return the bounds in words."""
        low, high = self.bounds()
        words = f", from {low:g}" if isfinite(low) else ""
        return words + (f", up to {high:g}" if isfinite(high) else "")


class Count(Discrete):
    """A count k, scaled: value = origin + step * k.

    Attributes
    ----------
    origin, step : float
        The value at a count of 0, and that of one count.
    """

    origin: Number = 0.0
    step: PositiveNumber = 1.0

    @abstractmethod
    def least(self) -> int:
        """Return the smallest count."""

    def counts(self) -> tuple[int, float]:
        """Return the smallest and the largest count within the bounds."""
        low, high = ((bound - self.origin) / self.step for bound in self.bounds())
        first = max(self.least(), int(np.ceil(low - ROUNDING))) if isfinite(low) else self.least()
        return first, float(np.floor(high + ROUNDING)) if isfinite(high) else inf

    def check_parameters(self) -> None:
        """Raise ValueError unless a value lies between the bounds."""
        first, last = self.counts()
        if not first <= last:
            low, high = self.bounds()
            raise ValueError(
                f"no value origin + step * k = {self.origin:g} + {self.step:g} k, k from {self.least()}, lies in"
                f" [lower, upper] = [{low:g}, {high:g}]; widen the bounds, or change origin or step"
            )

    def scaled(self, k: NDArray[np.int64]) -> Array:
        """Return the values of counts, shape (n,); never beyond a bound by rounding."""
        return np.clip(self.origin + self.step * k, *self.bounds())

    def support(self) -> tuple[float, float]:
        """Return the ends between which every value lies; infinite where there is no end."""
        first, last = self.counts()
        low, high = self.bounds()
        least, most = self.origin + self.step * first, self.origin + self.step * last
        return max(least, low), min(most, high)


class Poisson(Count):
    """Poisson distribution of a count k = 0, 1, 2, ...

    Attributes
    ----------
    rate : float
        Mean of the count, before a cut.
    """

    distribution: Literal["poisson"]
    rate: Annotated[float, Field(gt=0.0, le=LARGEST_RATE)]

    def least(self) -> int:
        """Return 0."""
        return 0

    def outcomes(self) -> tuple[Array, Array]:
        """Return values and probabilities; what is left out is less likely than 1e-25."""
        first, last = self.counts()
        reach, mode = int(12.0 * sqrt(self.rate)) + 60, int(self.rate)
        begin = max(first, int(min(last, mode)) - reach)
        k = np.arange(begin, int(min(last, max(first, mode) + reach)) + 1)
        logarithm = k * float(log(self.rate)) - np.array([lgamma(i + 1.0) for i in k.tolist()])
        return self.scaled(k), exp(logarithm - logarithm.max())

    def text(self) -> str:
        """Return the distribution in words and numbers."""
        return f"Poisson, mean count {self.rate:g}, {self.origin:g} + {self.step:g} k{self.between()}"


class Geometric(Count):
    """Geometric distribution of a count k = 1, 2, 3, ...: trials up to the first success.

    Attributes
    ----------
    probability : float
        Of success in one trial.
    """

    distribution: Literal["geometric"]
    probability: Annotated[float, Field(ge=LEAST_CHANCE, lt=1.0)]

    def least(self) -> int:
        """Return 1."""
        return 1

    def outcomes(self) -> tuple[Array, Array]:
        """Return values and probabilities; what is left out is less likely than 1e-26."""
        first, last = self.counts()
        k = np.arange(first, int(min(last, first + 60.0 / self.probability + 1.0)) + 1)
        return self.scaled(k), exp((k - first) * float(np.log1p(-self.probability)))

    def text(self) -> str:
        """Return the distribution in words and numbers."""
        return f"geometric, probability {self.probability:g}, {self.origin:g} + {self.step:g} k{self.between()}"
