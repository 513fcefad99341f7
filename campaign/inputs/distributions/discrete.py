"""Discrete distributions: Poisson, geometric, empirical, constant.

All but the constant are drawn from a table of values and probabilities, so that any cut keeps full precision.
"""

from abc import abstractmethod
from functools import cached_property
from math import inf, isfinite, lgamma, sqrt
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from campaign.inputs.distributions.base import Cuttable, Distribution, check_order
from engine.arrays import Array
from engine.mechanism.base import Number, PositiveNumber
from reporting.distributions.forms import exp, log

LARGEST_COUNT = 10**15  # above it, counts lose their last digit
ROUNDING = 1e-9  # of a step: a value this close to a bound counts as within it
LARGEST_RATE = 1e8  # of a Poisson distribution
LEAST_PROBABILITY = 1e-4  # of success, of a geometric distribution
LARGEST_SAMPLE = 100_000  # measured values

Values = Annotated[tuple[Number, ...], Field(strict=False, min_length=1, max_length=LARGEST_SAMPLE)]


class Discrete(Cuttable):
    """A discrete distribution."""

    @abstractmethod
    def outcomes(self) -> tuple[Array, Array]:
        """Return the values within the bounds, ascending, and their probabilities, both of shape (k,)."""

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
        low, high = self.cut()
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
        low, high = ((bound - self.origin) / self.step for bound in self.cut())
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
            low, high = self.cut()
            raise ValueError(
                f"no value origin + step * k = {self.origin:g} + {self.step:g} k, k from {self.least}, lies in"
                f" [lower, upper] = [{low:g}, {high:g}]; widen the bounds, or change origin or step"
            )
        self.check_size()

    def scaled(self, k: NDArray[np.int64]) -> Array:
        """Return the values of counts, shape (n,), clipped so that rounding moves none beyond a bound."""
        return np.clip(self.origin + self.step * k, *self.cut())

    def support(self) -> tuple[float, float]:
        (first, last), (low, high) = self.counts(), self.cut()
        least, most = self.origin + self.step * first, self.origin + self.step * last
        return min(max(least, low), high), max(min(most, high), low)


class Poisson(Count):
    """Poisson distribution of a count k = 0, 1, 2, ..."""

    least: ClassVar[int] = 0

    distribution: Literal["poisson"] = Field(description="Name of the distribution.")
    rate: Annotated[float, Field(gt=0.0, le=LARGEST_RATE)] = Field(
        description="Mean of the count before any cut, above 0, at most 1e8."
    )

    def outcomes(self) -> tuple[Array, Array]:
        """Return values and probabilities; counts less likely than 1e-25 are left out."""
        first, last = self.counts()
        reach, mode = int(12.0 * sqrt(self.rate)) + 60, int(self.rate)
        begin = max(first, int(min(last, mode)) - reach)
        k = np.arange(begin, int(min(last, max(first, mode) + reach)) + 1)
        logarithm = k * float(log(self.rate)) - np.array([lgamma(i + 1.0) for i in k.tolist()])
        return self.scaled(k), exp(logarithm - logarithm.max())

    def text(self) -> str:
        return f"Poisson, mean count {self.rate:g}, {self.origin:g} + {self.step:g} k{self.between()}"


class Geometric(Count):
    """Geometric distribution of a count k = 1, 2, 3, ...: number of trials up to the first success."""

    least: ClassVar[int] = 1

    distribution: Literal["geometric"] = Field(description="Name of the distribution.")
    probability: Annotated[float, Field(ge=LEAST_PROBABILITY, lt=1.0)] = Field(
        description="Probability of success in one trial, from 1e-4, below 1."
    )

    def outcomes(self) -> tuple[Array, Array]:
        """Return values and probabilities; counts less likely than 1e-26 are left out."""
        first, last = self.counts()
        # (1 - p)^(60 / p) is below exp(-60), which is 1e-26
        k = np.arange(first, int(min(last, first + 60.0 / self.probability + 1.0)) + 1)
        return self.scaled(k), exp((k - first) * float(np.log1p(-self.probability)))

    def text(self) -> str:
        return f"geometric, probability {self.probability:g}, {self.origin:g} + {self.step:g} k{self.between()}"


class Empirical(Discrete):
    """Measured values, each drawn with equal probability and any number of times."""

    smallest: ClassVar[float] = 0.0  # measured values may be of any size

    distribution: Literal["empirical"] = Field(description="Name of the distribution.")
    values: Values | None = Field(
        default=None, description="The measured values, in the target's unit; 1 to 100,000 numbers."
    )
    file: Annotated[str | None, Field(min_length=1)] = Field(
        default=None,
        description="CSV or Parquet file with the values, instead of them; its path is relative to the campaign file.",
    )
    column: Annotated[str | None, Field(min_length=1)] = Field(
        default=None, description="The column of the file that holds the values."
    )
    source: str = Field(default="", description="Where the values come from, in words.")
    joint: Annotated[str | None, Field(min_length=1, max_length=100)] = Field(
        default=None,
        description="Name of a table: variables with the same name take their values from one row of it, so that they"
        " vary together, as draws of a calibration; each varies by itself if absent.",
    )

    def check_parameters(self) -> None:
        """Raise ValueError unless there are values, and some within the bounds if bounds are given."""
        if self.joint and (self.lower, self.upper) != (None, None):
            raise ValueError("joint: its rows belong together, and bounds would cut some; remove lower and upper")
        if self.values is None and self.file is None and self.column is None:
            raise ValueError("its values are missing; give values, or file and column")
        if self.values is not None and (self.file or self.column):
            raise ValueError("values and file cannot be given together; give values, or file and column")
        if (self.file is None) != (self.column is None):
            raise ValueError("file and column are only valid together; give both, or values")
        if self.values is not None and self.outcomes()[0].size == 0:
            low, high = self.cut()
            raise ValueError(
                f"none of the {len(self.values)} values, {min(self.values):g} to {max(self.values):g}, lies in"
                f" [lower, upper] = [{low:g}, {high:g}]; widen the bounds"
            )

    def outcomes(self) -> tuple[Array, Array]:
        """Return the distinct values within the bounds and how often each was measured.

        Raises ValueError if the file has not been read.
        """
        if self.values is None:
            raise ValueError(f"the values of {self.file} have not been read; load the campaign from its file")
        values, times = np.unique(np.array(self.values), return_counts=True)
        low, high = self.cut()
        inside = (values >= low) & (values <= high)
        return values[inside], times[inside].astype(np.float64)

    @cached_property
    def _in_order(self) -> Array:
        return np.array(self.values)

    def rows(self, u: Array) -> Array:
        """Return the values in the rows that uniform numbers choose, in the order of the table, shape of ``u``."""
        return self._in_order[np.minimum((u * self._in_order.size).astype(np.int64), self._in_order.size - 1)]

    def text(self) -> str:
        origin = f" of {self.source}" if self.source else ""
        together = f", by rows of {self.joint}" if self.joint else ""
        return f"one of {len(self.values or ())} values{origin}{self.between()}{together}"


class Constant(Distribution):
    """One fixed value: sets a target for the whole campaign and documents it as an input."""

    distribution: Literal["constant"] = Field(description="Name of the distribution.")
    value: Number = Field(description="The value, in the target's unit.")

    def ppf(self, u: Array) -> Array:
        return np.full_like(u, self.value)

    def support(self) -> tuple[float, float]:
        return self.value, self.value

    def moments(self) -> tuple[float, float]:
        return self.value, 0.0

    def cdf(self, x: Array) -> Array:
        return np.asarray(x >= self.value, dtype=np.float64)

    def logpdf(self, x: Array) -> Array:
        return np.where(x == self.value, 0.0, -inf)

    def text(self) -> str:
        return f"constant {self.value:g}"
