"""Discrete distributions, drawn from a table of values and probabilities, so that any cut keeps full precision."""

from abc import abstractmethod
from functools import cached_property
from math import inf, isfinite, sqrt
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from campaign.inputs.distributions.base import Distribution, LowerBound, UpperBound, check_order
from campaign.inputs.distributions.elementary import log
from engine.arrays import Array
from engine.mechanism.base import Number, PositiveNumber

LARGEST_COUNT = 10**15  # above it, counts lose their last digit
ROUNDING = 1e-9  # of a step: a value this close to a bound counts as within it


class Discrete(Distribution):
    """A discrete distribution."""

    lower: LowerBound = None
    upper: UpperBound = None

    @abstractmethod
    def outcomes(self) -> tuple[Array, Array]:
        """Return the values within the bounds, ascending, and their probabilities, both of shape (k,)."""

    def check_parameters(self) -> None:
        """Raise ValueError if the parameters contradict each other."""

    def bounds(self) -> tuple[float, float]:
        """Return the lower and upper bound; infinite where there is none."""
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
        values, _, total = self._table
        return values[np.minimum(np.searchsorted(total, u), values.size - 1)]

    def cdf(self, x: Array) -> Array:
        values, _, total = self._table
        return np.append(0.0, total)[np.searchsorted(values, x, side="right")]

    def logpdf(self, x: Array) -> Array:
        values, shares, _ = self._table
        x = np.asarray(x, dtype=np.float64)
        at = np.minimum(np.searchsorted(values, x), values.size - 1)
        return np.where(values[at] == x, log(shares)[at], -inf)

    def moments(self) -> tuple[float, float]:
        values, shares, _ = self._table
        mean = float(shares @ values)
        return mean, sqrt(float(shares @ (values - mean) ** 2))

    def support(self) -> tuple[float, float]:
        values = self._table[0]
        return float(values[0]), float(values[-1])

    def between(self) -> str:
        """Return the bounds in words."""
        low, high = self.bounds()
        words = f", from {low:g}" if isfinite(low) else ""
        return words + (f", up to {high:g}" if isfinite(high) else "")


class Count(Discrete):
    """A count k, scaled: value = origin + step * k; ``least`` is the smallest count."""

    least: ClassVar[int]

    origin: Number = Field(default=0.0, description="Value at a count of 0, in the target's unit.")
    step: PositiveNumber = Field(
        default=1.0, description="Difference of the values of successive counts, in the target's unit, above 0."
    )

    def counts(self) -> tuple[int, float]:
        """Return the smallest and the largest count within the bounds."""
        low, high = ((bound - self.origin) / self.step for bound in self.bounds())
        first = max(self.least, int(np.ceil(low - ROUNDING))) if isfinite(low) else self.least
        return first, float(np.floor(high + ROUNDING)) if isfinite(high) else inf

    def check_parameters(self) -> None:
        """Raise ValueError unless a value lies between the bounds."""
        first, last = self.counts()
        if first > LARGEST_COUNT and self.lower is not None:
            raise ValueError(
                f"lower = {self.lower:g} is a count of {first:g}; allowed: to {LARGEST_COUNT:g}; reduce it"
            )
        if not first <= last:
            low, high = self.bounds()
            raise ValueError(
                f"no value origin + step * k = {self.origin:g} + {self.step:g} k, k from {self.least}, lies in"
                f" [lower, upper] = [{low:g}, {high:g}]; widen the bounds, or change origin or step"
            )
        self.check_size()

    def scaled(self, k: NDArray[np.int64]) -> Array:
        """Return the values of counts, shape (n,), clipped so that rounding moves none beyond a bound."""
        return np.clip(self.origin + self.step * k, *self.bounds())

    def support(self) -> tuple[float, float]:
        first, last = self.counts()
        low, high = self.bounds()
        least, most = self.origin + self.step * first, self.origin + self.step * last
        return min(max(least, low), high), max(min(most, high), low)
