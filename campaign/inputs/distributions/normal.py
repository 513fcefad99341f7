"""Normal distributions: by mean and standard deviation, or by nominal, tolerance and the capability assumed."""

from typing import ClassVar, Literal

import numpy as np

from campaign.inputs.distributions.base import Array, PositiveNumber, chosen
from campaign.inputs.distributions.continuous import Continuous
from engine.mechanism.base import Number

HALF_LOG_TWO_PI = 0.9189385332046728


class Normal(Continuous):
    """Normal distribution.

    Attributes
    ----------
    mean, std : float or None
        Mean and standard deviation, before a cut.
    nominal, tolerance, cpk : float or None
        Instead: the mean is the nominal, the standard deviation tolerance / (3 cpk).
    """

    hint: ClassVar[str] = ""

    distribution: Literal["normal"]
    mean: Number | None = None
    std: PositiveNumber | None = None
    nominal: Number | None = None
    tolerance: PositiveNumber | None = None
    cpk: PositiveNumber | None = None

    @property
    def location(self) -> float:
        """Mean before the cut."""
        return self.mean if self.mean is not None else self.nominal or 0.0

    @property
    def scale(self) -> float:
        """Standard deviation before the cut."""
        if self.tolerance is not None and self.cpk is not None:
            return self.tolerance / (3.0 * self.cpk)
        return self.std or 0.0

    def check_parameters(self) -> None:
        """Raise ValueError unless one set of parameters is complete and the nominal within the bounds."""
        chosen(self, ("mean", "std"), ("nominal", "tolerance", "cpk"), hint=self.hint)
        low, high = self.cut()
        if self.nominal is not None and not low <= self.nominal <= high:
            raise ValueError(
                f"nominal = {self.nominal:g} lies outside of [lower, upper] = [{low:g}, {high:g}];"
                " move the nominal or the bounds"
            )

    def parent_cdf(self, x: Array) -> Array:
        """Return the probability of values up to ``x``."""
        from scipy.special import ndtr

        return np.asarray(ndtr((x - self.location) / self.scale))

    def parent_sf(self, x: Array) -> Array:
        """Return the probability of values above ``x``."""
        from scipy.special import ndtr

        return np.asarray(ndtr(-((x - self.location) / self.scale)))

    def parent_ppf(self, p: Array) -> Array:
        """Return the value with probability ``p`` below it."""
        from scipy.special import ndtri

        return np.asarray(self.location + self.scale * ndtri(p))

    def parent_isf(self, q: Array) -> Array:
        """Return the value with probability ``q`` above it."""
        from scipy.special import ndtri

        return np.asarray(self.location - self.scale * ndtri(q))

    def parent_logpdf(self, x: Array) -> Array:
        """Return the logarithm of the density at ``x``."""
        z = (x - self.location) / self.scale
        return np.asarray(-0.5 * z * z - HALF_LOG_TWO_PI - np.log(self.scale))

    def parent_moments(self) -> tuple[float, float]:
        """Return mean and standard deviation before the cut."""
        return self.location, self.scale

    def parent_support(self) -> tuple[float, float]:
        """Return no ends."""
        return -np.inf, np.inf

    def words(self) -> str:
        """Return name and parameters."""
        origin = "" if self.cpk is None else f" (tolerance {self.tolerance:g}, assumed Cpk {self.cpk:g})"
        return f"normal, mean {self.location:g}, sd {self.scale:g}{origin}"


class TruncatedNormal(Normal):
    """Normal distribution cut to [lower, upper]; what a variable is that names no distribution.

    Attributes
    ----------
    lower, upper : float
        Both bounds.
    """

    hint: ClassVar[str] = "; or name another distribution, this one is meant where none is named"

    distribution: Literal["truncated_normal"] = "truncated_normal"  # type: ignore[assignment]
    lower: Number
    upper: Number

    def words(self) -> str:
        """Return name and parameters."""
        return f"truncated {super().words()}"
