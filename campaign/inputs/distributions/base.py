"""What distributions share: their interface, and checks of their keys."""

from abc import abstractmethod
from collections.abc import Iterator
from functools import cached_property
from math import exp as exp_of
from math import inf, isfinite, sqrt
from typing import Annotated, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator
from scipy.special import ndtri

from engine.arrays import Array
from engine.mechanism.base import LARGEST_NUMBER, SMALLEST_NUMBER, Number, PositiveNumber, TableModel
from reporting.distributions.forms import ClosedForm

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

    def tried(self) -> tuple[float, float]:
        """Return the two values at which the variable is tried on the mechanism: its ends."""
        return self.ends()

    def ends(self) -> tuple[float, float]:
        """Return the support, with an infinite end replaced by the quantile that has probability 1e-6 beyond it."""
        low, high = self.support()
        tails = self.ppf(np.array([TAIL, 1.0 - TAIL]))
        return (low if np.isfinite(low) else float(tails[0])), (high if np.isfinite(high) else float(tails[1]))


class Cuttable(Distribution):
    """A distribution that may be cut to bounds."""

    lower: LowerBound = None
    upper: UpperBound = None

    def check_parameters(self) -> None:
        """Raise ValueError if the parameters contradict each other."""

    def cut(self) -> tuple[float, float]:
        """Return the bounds to which the distribution is cut; infinite where it is not cut."""
        return (-inf if self.lower is None else self.lower), (inf if self.upper is None else self.upper)


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


# Distributions with a density: cut to bounds, and shifted from one production batch to the next.
#
# Cutting and shifting are done here for all of them. A *parent* distribution gives probabilities and quantiles from
# either tail, so that no digit is lost if the bounds leave only a far tail. The distribution in a production batch is
# the parent, moved by the shift d of the batch and then cut to the bounds:
#
#     X | d  =  d + X0, given lower <= d + X0 <= upper,    d normal with mean 0, cut at 6 standard deviations
#
# So the bounds hold in every production batch, as if each batch were inspected. The distribution over all batches is
# the mixture of these.

LARGEST_SHIFT = 6.0  # in standard deviations; without the cut, two in a thousand million would be larger
LEAST_PROBABILITY = 1e-290  # between the bounds; below it, quantiles lose digits
TINIEST = float(np.finfo(np.float64).tiny)
SHIFTS = 97  # number of shifts at which a mixture over production batches is evaluated
# limits, as probabilities, of the intervals over which moments are integrated; the decades resolve any tail, the even
# steps a kink of the density
DECADES = np.array([300, 250, 200, 150, 100, 70, 50, 40, 30, 25, *range(20, 0, -1)], dtype=np.float64)
EDGES = np.concatenate([[0.0], 10.0**-DECADES, np.linspace(0.12, 0.5, 20)])
NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)

Window = tuple[Array, Array, Array, NDArray[np.bool_]]


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


class Continuous(Cuttable):
    """A distribution with a density."""

    batch: ProductionBatch | None = Field(
        default=None, description="Shifts of whole production batches; all parts are of one batch if absent."
    )

    @abstractmethod
    def parent(self) -> ClosedForm:
        """Return the distribution before cuts and shifts."""

    @abstractmethod
    def words(self) -> str:
        """Return name and parameters of the parent."""

    @model_validator(mode="after")
    def _can_be_drawn(self) -> Self:
        if self.lower is not None and self.upper is not None:
            check_order(self.lower, self.upper)
        self.check_parameters()
        lower, upper = self.cut()
        reach = self.batch.reach if self.batch else 0.0
        for shift in dict.fromkeys((0.0, -reach, reach)):
            probability = float(self._window(shift)[2])
            if not probability >= LEAST_PROBABILITY:
                where = f"in a production batch shifted by {shift:g} (6 batch.std), " if shift else ""
                remedy = "reduce batch.std" if shift else "change its parameters"
                raise ValueError(
                    f"{where}[lower, upper] = [{lower:g}, {upper:g}] holds a share of {probability:.3g} of"
                    f" {self.words()}: nothing can be drawn there; move or widen the bounds, or {remedy}"
                )
        self.check_size()
        return self

    def ppf(self, u: Array, shift: float | Array = 0.0) -> Array:
        """Return the quantiles at probabilities ``u`` in production batches with the given shifts."""
        unshifted = isinstance(shift, float) and shift == 0.0
        below, above, probability, from_above = self._unshifted_window if unshifted else self._window(shift)
        parent = self.parent()
        x = parent.ppf(below + u * probability)
        if from_above.any():
            x = np.where(from_above, parent.isf(above + (1.0 - u) * probability), x)
        return np.clip(np.asarray(x + shift, dtype=np.float64), *self.cut())

    def cdf(self, x: Array) -> Array:
        x = np.asarray(x, dtype=np.float64)
        return np.asarray(sum(share * self._cdf(x, shift) for shift, share in self._shifts()), dtype=np.float64)

    def logpdf(self, x: Array) -> Array:
        x = np.asarray(x, dtype=np.float64)
        result, (low, high) = np.full_like(x, -inf), self.cut()
        for shift, share in self._shifts():
            probability = float(self._window(shift)[2])
            with np.errstate(all="ignore"):  # where there is no value
                inside = self.parent().logpdf(x - shift) + float(np.log(share / probability))
            result = np.logaddexp(result, np.where((x >= low) & (x <= high) & ~np.isnan(inside), inside, -inf))
        return result

    def support(self) -> tuple[float, float]:
        reach = self.batch.reach if self.batch else 0.0
        (low, high), (lower, upper) = self.parent().support, self.cut()
        return max(low - reach, lower), min(high + reach, upper)

    def moments(self) -> tuple[float, float]:
        of_shifts = [(share, *self._moments(shift)) for shift, share in self._shifts()]
        mean = sum(share * m for share, m, _ in of_shifts)
        return mean, sqrt(sum(share * (s * s + (m - mean) ** 2) for share, m, s in of_shifts))

    def density_points(self, count: int = 101) -> tuple[tuple[float, float], ...]:
        low, high = self.ends()
        x = np.linspace(low, high, count)
        if not np.all(self.logpdf(x[[0, -1]]) < inf):  # show an infinite density slightly inside of its end
            x = np.clip(x, low + 1e-6 * (high - low), high - 1e-6 * (high - low))
        return tuple(zip(x.tolist(), np.exp(self.logpdf(x)).tolist(), strict=True))

    def ends(self) -> tuple[float, float]:
        if self.batch is None:
            return super().ends()
        from scipy.optimize import brentq  # heavy, and only a report of production batches needs it

        def quantile(p: float) -> float:
            least, most = (float(self.ppf(np.array([p]), shift)[0]) for shift in (-batch.reach, batch.reach))
            if excess(least, p) >= 0.0:  # the shifts vanish beside the values in double precision
                return least
            return most if excess(most, p) <= 0.0 else float(brentq(excess, least, most, (p,)))

        def excess(x: float, p: float) -> float:
            return float(self.cdf(np.array([x]))[0]) - p

        batch, (low, high) = self.batch, self.support()
        return (low if isfinite(low) else quantile(TAIL)), (high if isfinite(high) else quantile(1.0 - TAIL))

    def text(self) -> str:
        words, (low, high) = [self.words()], self.cut()
        if isfinite(low) or isfinite(high):
            one = f"from {low:g}" if isfinite(low) else f"up to {high:g}"
            words.append(f"between {low:g} and {high:g}" if isfinite(low) and isfinite(high) else one)
        if self.batch:
            words.append(f"batches of {self.batch.size} shifted with sd {self.batch.std:g}")
        return ", ".join(words)

    @cached_property
    def _unshifted_window(self) -> Window:
        return self._window(0.0)

    def _window(self, shift: float | Array) -> Window:
        """Return the probabilities below, above and between the bounds, and whether to count from the upper tail."""
        lower, upper = (np.asarray(bound - shift) for bound in self.cut())
        parent = self.parent()
        below, above = np.asarray(parent.cdf(lower)), np.asarray(parent.sf(upper))
        from_above = below > 0.5
        between = np.where(from_above, parent.sf(lower) - above, parent.cdf(upper) - below)
        return below, above, between, from_above

    def _shifts(self) -> Iterator[tuple[float, float]]:
        """Yield shifts of production batches and the share of each."""
        if self.batch is None:
            yield 0.0, 1.0
            return
        t = np.linspace(-LARGEST_SHIFT, LARGEST_SHIFT, SHIFTS)
        density = [exp_of(-0.5 * z * z) for z in t]
        yield from ((self.batch.std * float(z), d / sum(density)) for z, d in zip(t, density, strict=True))

    def _cdf(self, x: Array, shift: float) -> Array:
        below, _, probability, from_above = self._window(shift)
        lower, upper = self.cut()
        x = np.clip(x, lower, upper) - shift
        parent = self.parent()
        inside = parent.sf(np.asarray(lower - shift)) - parent.sf(x) if from_above else parent.cdf(x) - below
        return np.clip(inside / probability, 0.0, 1.0)

    def _moments(self, shift: float) -> tuple[float, float]:
        parent, (lower, upper) = self.parent(), self.cut()
        lowest, highest = parent.support
        if lower <= lowest + shift and highest + shift <= upper:  # nothing is cut off
            mean, std = parent.moments()
            return mean + shift, std
        low, high = EDGES[:-1], EDGES[1:]
        half = 0.5 * (high - low)
        v, weight = 0.5 * (high + low)[:, None] + half[:, None] * NODES, half[:, None] * WEIGHTS
        tails = self._tail(v, shift, upper=False), self._tail(v, shift, upper=True)
        mean = float(sum(np.sum(weight * x) for x in tails))
        return mean, sqrt(float(sum(np.sum(weight * (x - mean) ** 2) for x in tails)))

    def _tail(self, v: Array, shift: float, *, upper: bool) -> Array:
        """Return the values with probability ``v`` between them and the lower or the upper end."""
        parent, (below, above, probability, _) = self.parent(), self._window(shift)
        beyond = np.maximum(v * probability, TINIEST)  # 0 would have no finite quantile
        if upper:
            nearer = above <= 0.5
            x = parent.isf(above + beyond) if nearer else parent.ppf(below + (1.0 - v) * probability)
        else:
            nearer = below <= 0.5
            x = parent.ppf(below + beyond) if nearer else parent.isf(above + (1.0 - v) * probability)
        return np.clip(x + shift, *self.cut())
