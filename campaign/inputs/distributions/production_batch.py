"""How parts vary from one production batch to the next."""

from typing import Annotated

import numpy as np
from pydantic import Field
from scipy.special import ndtri

from engine.arrays import Array
from engine.mechanism.base import PositiveNumber, TableModel

LARGEST_SHIFT = 6.0  # in standard deviations; without the cut, two in a thousand million would be larger


class ProductionBatch(TableModel, strict=True):
    """A shift that all parts of a production batch share: normal with mean 0, cut at 6 standard deviations."""

    size: Annotated[int, Field(ge=1, le=100_000_000)] = Field(
        description="Number of consecutive samples with the same shift, at least 1."
    )
    std: PositiveNumber = Field(description="Standard deviation of the shift, in the target's unit, above 0.")

    @property
    def reach(self) -> float:
        """The largest shift, in the target's unit."""
        return LARGEST_SHIFT * self.std

    def shifts(self, u: Array) -> Array:
        """Return the shifts at probabilities ``u`` inside (0, 1), in the target's unit; same shape."""
        return np.asarray(self.std * np.clip(ndtri(u), -LARGEST_SHIFT, LARGEST_SHIFT), dtype=np.float64)
