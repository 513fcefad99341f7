"""What every distribution of an input can tell: quantiles, probabilities, moments, ends, itself in words."""

from abc import abstractmethod
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from engine.mechanism.base import Number, TableModel

Array = NDArray[np.float64]
PositiveNumber = Annotated[Number, Field(gt=0.0)]

TAIL = 1e-6  # probability beyond the ends at which an unbounded variable is tried on the mechanism


class Distribution(TableModel, strict=True):
    """A random input of the mechanism.

    Attributes
    ----------
    target : str or None
        Key of the mechanism it sets; None means the variable's own name.
    """

    kind_key: ClassVar[str] = "distribution"

    target: Annotated[str | None, Field(min_length=1)] = None

    @abstractmethod
    def ppf(self, u: Array) -> Array:
        """Return the quantiles at probabilities ``u``, each in (0, 1); same shape, in the target's unit."""

    @abstractmethod
    def cdf(self, x: Array) -> Array:
        """Return the probability of values up to ``x``; same shape."""

    @abstractmethod
    def logpdf(self, x: Array) -> Array:
        """Return the logarithm of the density [1/unit] at ``x``, of the probability if discrete; same shape."""

    @abstractmethod
    def support(self) -> tuple[float, float]:
        """Return the ends between which every value lies; infinite where there is no end."""

    @abstractmethod
    def moments(self) -> tuple[float, float]:
        """Return mean and standard deviation of what is drawn: truncation and production batches included."""

    @abstractmethod
    def text(self) -> str:
        """Return the distribution in words and numbers, without unit."""

    def density_points(self, count: int = 101) -> tuple[tuple[float, float], ...]:
        """Return ``count`` points (x, density) between the ends, for drawing; none if there is no density."""
        return ()

    def ends(self) -> tuple[float, float]:
        """Return the support, an infinite end replaced by the quantile with probability 1e-6 beyond it."""
        low, high = self.support()
        tails = self.ppf(np.array([TAIL, 1.0 - TAIL]))
        return (low if np.isfinite(low) else float(tails[0])), (high if np.isfinite(high) else float(tails[1]))


def check_order(lower: float, upper: float) -> None:
    """Raise ValueError unless two bounds leave room between them."""
    if not lower < upper:
        raise ValueError(f"lower = {lower:g} is not below upper = {upper:g}; exchange or widen the bounds")


def chosen(table: TableModel, *groups: tuple[str, ...], hint: str = "") -> tuple[str, ...]:
    """Return which of several groups of keys a distribution is given by; ``hint`` says what else to do if by none.

    Raises
    ------
    ValueError
        If it is none of them, more than one, or one in part.
    """
    given = [key for group in groups for key in group if getattr(table, key) is not None]
    ways = " or ".join(" and ".join(group) for group in groups)
    if not given:
        raise ValueError(f"nothing says how it is spread; give {ways}{hint}")
    group = next(group for group in groups if given[0] in group)
    other = [key for key in given if key not in group]
    if other:
        raise ValueError(f"{given[0]} and {other[0]} are two ways to say the same; give {ways}, not both")
    missing = [key for key in group if key not in given]
    if missing:
        raise ValueError(f"{given[0]} needs {' and '.join(missing)} beside it; give {ways}")
    return group
