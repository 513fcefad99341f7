"""What distributions share: their interface, and checks of their keys."""

from abc import abstractmethod
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from engine.arrays import Array
from engine.mechanism.base import LARGEST_NUMBER, SMALLEST_NUMBER, Number, PositiveNumber, TableModel

LowerBound = Annotated[
    Number | None,
    Field(description="Lower bound at which the distribution is cut, in the target's unit; no bound if absent."),
]
UpperBound = Annotated[
    Number | None,
    Field(description="Upper bound at which the distribution is cut, in the target's unit; no bound if absent."),
]
StandardDeviation = Annotated[
    PositiveNumber | None, Field(description="Standard deviation before the cut, in the target's unit, above 0.")
]

DRAWN = np.array([2.0**-54, 1.0 - 2.0**-53])  # the smallest and the largest probability that is drawn
TAIL = 1e-6  # probability beyond each end at which an unbounded variable is tried on the mechanism


class Distribution(TableModel, strict=True):
    """The distribution of an input of the mechanism.

    Values, bounds and parameters are in the unit of the key that the variable sets. Methods that take an array return
    one of the same shape, and an element of the result depends on its own argument alone, bit for bit.
    """

    kind_key: ClassVar[str] = "distribution"
    smallest: ClassVar[float] = SMALLEST_NUMBER

    target: Annotated[str | None, Field(min_length=1)] = Field(
        default=None,
        description="Key of the mechanism that the variable sets, such as J1, joints.J1.bearing.point.x or "
        "parameters.arm; the variable's own name if absent.",
    )

    def check_size(self) -> None:
        """Raise ValueError if values that can be drawn, or their mean or deviation, are implausibly large."""
        tried = self.model_copy()  # so that this object does not cache what is computed here
        with np.errstate(all="ignore"):  # values that are not finite are refused below
            try:
                low, high = tried.ppf(DRAWN).tolist()
                sizes = np.abs([low, high, *tried.moments()])
            except OverflowError:
                low, high, sizes = -np.inf, np.inf, np.array([np.inf])
        if not (sizes <= LARGEST_NUMBER).all():
            raise ValueError(
                f"its values reach from {low:g} to {high:g}: not plausible for a physical quantity; allowed: up to"
                f" {LARGEST_NUMBER:g}; reduce its spread, or cut it with lower and upper"
            )

    @abstractmethod
    def ppf(self, u: Array) -> Array:
        """Return the quantiles at probabilities ``u``, each in (0, 1)."""

    @abstractmethod
    def cdf(self, x: Array) -> Array:
        """Return the probability of values up to ``x``."""

    @abstractmethod
    def logpdf(self, x: Array) -> Array:
        """Return the logarithm of the density [1/unit] at ``x``; of the probability if the distribution is discrete.

        It is minus infinity for a value that is never drawn.
        """

    @abstractmethod
    def support(self) -> tuple[float, float]:
        """Return the lower and upper end of the values; infinite where there is no end."""

    @abstractmethod
    def moments(self) -> tuple[float, float]:
        """Return mean and standard deviation of the drawn values, including cuts and production batches."""

    @abstractmethod
    def text(self) -> str:
        """Return the distribution in words and numbers, without units."""

    def density_points(self, count: int = 101) -> tuple[tuple[float, float], ...]:
        """Return ``count`` points (x, density) between the ends, for plotting; empty if there is no density."""
        return ()

    def ends(self) -> tuple[float, float]:
        """Return the support, with an infinite end replaced by the quantile that has probability 1e-6 beyond it."""
        low, high = self.support()
        tails = self.ppf(np.array([TAIL, 1.0 - TAIL]))
        return (low if np.isfinite(low) else float(tails[0])), (high if np.isfinite(high) else float(tails[1]))


def check_order(lower: float, upper: float) -> None:
    """Raise ValueError unless the lower bound is below the upper bound."""
    if not lower < upper:
        raise ValueError(f"lower = {lower:g} is not below upper = {upper:g}; exchange or widen the bounds")


def check_parameter_groups(table: TableModel, *groups: tuple[str, ...], hint: str = "") -> None:
    """Raise ValueError unless a distribution is given by exactly one of several groups of keys, all of it.

    ``hint`` is another remedy for the message if no group is given.
    """
    given = [key for group in groups for key in group if getattr(table, key) is not None]
    choices = " or ".join(" and ".join(group) for group in groups)
    if not given:
        raise ValueError(f"its parameters are missing; give {choices}{hint}")
    group = max(groups, key=lambda group: len(set(group) & set(given)))
    other = [key for key in given if key not in group]
    if other:
        own = next(key for key in given if key in group)
        raise ValueError(
            f"{own} and {other[0]} cannot be given together, because each defines the distribution; give {choices}"
        )
    missing = [key for key in group if key not in given]
    if missing:
        raise ValueError(
            f"{next(key for key in group if key in given)} is given without {' and '.join(missing)}; give {choices}"
        )
