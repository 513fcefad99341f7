"""Empirical distribution of measured values."""

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from campaign.inputs.distributions.discrete import Discrete
from engine.arrays import Array
from engine.mechanism.base import Number

LARGEST_SAMPLE = 100_000  # measured values

Values = Annotated[tuple[Number, ...], Field(strict=False, min_length=1, max_length=LARGEST_SAMPLE)]


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

    def check_parameters(self) -> None:
        """Raise ValueError unless there are values, and some within the bounds if bounds are given."""
        if self.values is None and self.file is None and self.column is None:
            raise ValueError("its values are missing; give values, or file and column")
        if self.values is not None and (self.file or self.column):
            raise ValueError("values and file cannot be given together; give values, or file and column")
        if (self.file is None) != (self.column is None):
            raise ValueError("file and column are only valid together; give both, or values")
        if self.values is not None and self.outcomes()[0].size == 0:
            low, high = self.bounds()
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
        low, high = self.bounds()
        inside = (values >= low) & (values <= high)
        return values[inside], times[inside].astype(np.float64)

    def text(self) -> str:
        origin = f" of {self.source}" if self.source else ""
        return f"one of {len(self.values or ())} values{origin}{self.between()}"
