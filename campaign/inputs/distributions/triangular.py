"""Triangular distribution."""

from typing import Any, Literal

import numpy as np
from pydantic import Field

from campaign.inputs.distributions.bounded import Cut
from campaign.inputs.distributions.elementary import log
from engine.arrays import Array
from engine.mechanism.base import Number


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
