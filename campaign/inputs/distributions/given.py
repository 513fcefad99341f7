"""Distributions without a law: measured values, and a constant."""

from math import inf
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from campaign.inputs.distributions.base import Array, Distribution
from campaign.inputs.distributions.discrete import Discrete
from engine.mechanism.base import Number

LARGEST_SAMPLE = 100_000  # measured values

Values = Annotated[tuple[Number, ...], Field(strict=False, min_length=1, max_length=LARGEST_SAMPLE)]


class Empirical(Discrete):
    """Measured values, drawn again with equal probability each.

    Attributes
    ----------
    values : tuple of float or None
        The values.
    file, column : str or None
        Instead: a CSV or Parquet file, relative to the campaign file, and its column; read when the campaign is loaded.
    source : str
        Where the values come from.
    """

    distribution: Literal["empirical"]
    values: Values | None = None
    file: Annotated[str | None, Field(min_length=1)] = None
    column: Annotated[str | None, Field(min_length=1)] = None
    source: str = ""

    def check_parameters(self) -> None:
        """Raise ValueError unless there are values, within the bounds if there are any."""
        if self.values is None and self.file is None and self.column is None:
            raise ValueError("no values; give values, or file and column")
        if self.values is not None and (self.file or self.column):
            raise ValueError("values and file are two ways to say the same; give values, or file and column, not both")
        if (self.file is None) != (self.column is None):
            raise ValueError("file and column belong together; give both, or values")
        if self.values is not None and self.outcomes()[0].size == 0:
            low, high = self.bounds()
            raise ValueError(
                f"none of the {len(self.values)} values, {min(self.values):g} to {max(self.values):g}, lies in"
                f" [lower, upper] = [{low:g}, {high:g}]; widen the bounds"
            )

    def outcomes(self) -> tuple[Array, Array]:
        """Return the different values within the bounds and how often each was measured.

        Raises
        ------
        ValueError
            If the file has not been read.
        """
        if self.values is None:
            raise ValueError(f"the values of {self.file} have not been read; load the campaign from its file")
        values, times = np.unique(np.array(self.values), return_counts=True)
        low, high = self.bounds()
        inside = (values >= low) & (values <= high)
        return values[inside], times[inside].astype(np.float64)

    def text(self) -> str:
        """Return the distribution in words and numbers."""
        origin = f" of {self.source}" if self.source else ""
        return f"one of {len(self.values or ())} values{origin}{self.between()}"


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

    def logpdf(self, x: Array) -> Array:
        """Return 0 at the value, minus infinity elsewhere."""
        return np.where(x == self.value, 0.0, -inf)

    def text(self) -> str:
        """Return the distribution in words and numbers."""
        return f"constant {self.value:g}"
