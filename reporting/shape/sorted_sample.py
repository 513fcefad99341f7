"""A sorted sample made ready for fits: its repeated values, and a few hundred or thousand weighted values.

Repeated values are atoms, where a stop or a plateau collects a share of all values, or rounded values. No density
describes an atom: the likelihood of an ever narrower density grows without bound. Rounded values repeat too, but about
as often as their neighbours do.

Of a large sample both tails are kept unchanged, because they decide a capability; between them neighbours are averaged
in blocks. The error of a sum of a smooth function is of second order in the width of a block: a few tenths of a unit of
log-likelihood for a million values, nearly the same for every family.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import pdtrc

from reporting.arrays import PIECE, Array
from reporting.capability.moments import location_and_shape
from reporting.errors import finite_in_order

# Values closer than this part of their usual distance differ by rounding errors only.
_EQUAL = 1e-4
# An atom has this many times the values of its neighbours, more than occurs by chance in a thousand samples, and at
# least this share of all values.
_RATIO, _CHANCE, _LEAST_SHARE = 2.5, 1e-3, 0.01
# Number of neighbours on each side.
_REACH = 2
_BLOCKS = 16  # of a sample that is binned, at a time
# A response with fewer different values than this is discrete.
FEWEST_VALUES = 10


@dataclass(frozen=True)
class Atom:
    """A value that a considerable share of all values has."""

    value: float  # in the unit of the values
    count: int
    share: float  # of all values
    where: str  # "lowest", "highest" or "inside": the smallest value, the largest, or one in between

    @property
    def words(self) -> str:
        """The atom in a sentence."""
        what = {"inside": "a plateau or a preferred number", "lowest": "the smallest value: a stop or a plateau"}
        percent = f"{100 * self.share:.3g} % of the values ({self.count}) are {self.value:.6g}"
        return f"{percent}, {what.get(self.where, 'the largest value: a stop or a plateau')}."


@dataclass(frozen=True)
class Ties:
    """Distinct values and their counts."""

    values: Array  # ascending, shape (m,)
    counts: NDArray[np.int64]  # shape (m,)

    @property
    def discrete(self) -> bool:
        """Whether there are too few distinct values to be described by a density."""
        return self.values.size < FEWEST_VALUES and 2 * self.values.size < self.counts.sum()

    def atoms(self) -> tuple[Atom, ...]:
        """Return the atoms, the lowest first."""
        n, m = int(self.counts.sum()), self.values.size
        if m < 2 * _REACH or m == n:
            return ()
        several = np.flatnonzero(self.counts > 1)
        counts, usual = self.counts[several], _neighbours(self.counts, several)
        # Without rounding all values are distinct: a count above one occurs by chance at the rate of the neighbours.
        rate = np.maximum(usual - 1 + np.sqrt(usual - 1), (n - m) / m)
        proven = m * pdtrc(counts - 2, rate) < _CHANCE
        end = (several == 0) | (several == m - 1)
        found = several[proven & (counts >= _RATIO * usual) & (end | (counts >= _LEAST_SHARE * n))]
        where = {0: "lowest", m - 1: "highest"}
        return tuple(
            Atom(float(self.values[i]), int(self.counts[i]), float(self.counts[i] / n), where.get(int(i), "inside"))
            for i in found
        )

    @property
    def step(self) -> float:
        """The step to which the values are rounded; 0 if most of them differ from all others."""
        if 2 * self.values.size > self.counts.sum():
            return 0.0
        return float(np.median(np.diff(self.values)))

    def spread(self, ordered: Array) -> Array:
        """Return the values as they were given; equal ones are spread evenly over the range that rounds to them."""
        if self.values.size == ordered.size:
            return ordered
        last, every = self.values.size - 1, ordered.copy()
        several = np.flatnonzero(self.counts > 1)
        count = self.counts[several]
        first = several + np.cumsum(count - 1) - (count - 1)
        gaps = [
            (self.values[to] - self.values[at]) / 2
            for at, to in ((several, several + 1), (several - 1, several))
            for at, to in ((np.clip(at, 0, last - 1), np.clip(to, 1, last)),)
        ]
        half = np.minimum(*gaps)
        place = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        across = (2 * place + 1) / np.repeat(count, count) - 1
        alike = np.repeat(self.values[several], count)
        every[np.repeat(first, count) + place] = alike + across * np.repeat(half, count)
        return every


@dataclass(frozen=True)
class Repetition:
    """How the values of a sample repeat."""

    distinct: int  # values
    discrete: bool  # there are too few distinct values to be described by a density
    step: float  # to which the values are rounded; 0 if most of them differ from all others
    atoms: tuple[Atom, ...]  # the lowest first


@dataclass(frozen=True)
class SortedSample:
    """The finite values of a response in ascending order, shape (n,), with what several methods ask of them."""

    values: Array
    known: dict[str, float] | None = None  # location, where it has been computed

    @cached_property
    def location(self) -> dict[str, float]:
        """Location, spread and shape; a number may be infinite or missing."""
        if self.known is not None:
            return self.known
        with np.errstate(over="ignore", invalid="ignore"):
            return location_and_shape(self.values, self.values)

    @property
    def repetition(self) -> "Repetition":
        """How values repeat; of values that are not all equal."""
        return self._repeated[0]

    @property
    def spread(self) -> Array:
        """Values of which equal ones are spread over the range that rounds to them; of values not all equal."""
        return self._repeated[1]

    @cached_property
    def _repeated(self) -> "tuple[Repetition, Array]":
        tied = ties(self.values)
        return Repetition(tied.values.size, tied.discrete, tied.step, tied.atoms()), tied.spread(self.values)

    def quantiles(self, shares: ArrayLike) -> Array:
        """Return the quantiles that `numpy.quantile` interpolates."""
        place = (self.values.size - 1) * np.asarray(shares, np.float64)
        below = np.floor(place).astype(np.int64)
        low, high = self.values[below], self.values[np.minimum(below + 1, self.values.size - 1)]
        part, step = place - below, high - low
        return np.asarray(np.where(part < 0.5, low + part * step, high - (1 - part) * step))


def sorted_sample(x: ArrayLike | SortedSample) -> SortedSample:
    """Return the finite ones of values in ascending order; ReportError: they are not a series of numbers."""
    return x if isinstance(x, SortedSample) else SortedSample(finite_in_order(x))


def ties(ordered: Array) -> Ties:
    """Return the distinct ones of ascending finite values, shape (n,), not all equal; rounding errors are merged."""
    quarter, three_quarters = ordered[[ordered.size // 4, (3 * ordered.size) // 4]]
    # The range between quartiles, because a single distant value would inflate the usual distance.
    usual = float(three_quarters - quarter or ordered[-1] - ordered[0]) / ordered.size
    begins = np.ones(ordered.size, np.bool_)
    for at in range(1, ordered.size, PIECE):
        part = ordered[at : at + PIECE]
        begins[at : at + part.size] = part - ordered[at - 1 : at - 1 + part.size] > _EQUAL * usual
    # Of columns of millions the few that repeat are described, not all that do not.
    again = np.flatnonzero(~begins)
    firsts = np.flatnonzero(begins[again - 1])  # of the runs of these
    first, more = again[firsts] - 1, np.diff(firsts, append=again.size)
    counts = np.ones(ordered.size - again.size, np.int64)
    counts[first - firsts] += more
    begins[first] = False
    begins[first + more // 2] = True  # the middle one stands for all that are equal
    return Ties(ordered[begins], counts)


def _neighbours(counts: NDArray[np.int64], at: NDArray[np.intp]) -> Array:
    """Return the mean count of the neighbours of some values."""
    near = at + np.array([[k] for k in range(-_REACH, _REACH + 1) if k])
    present = (near >= 0) & (near < counts.size)
    total = np.where(present, counts[np.clip(near, 0, counts.size - 1)], 0).sum(axis=0)
    return np.asarray(total / present.sum(axis=0))


@dataclass(frozen=True)
class BinnedSample:
    """A sorted sample as weighted values."""

    values: Array  # ascending, shape (m,)
    weights: Array  # values of the sample that each one represents, shape (m,); the sum is n
    n: int  # size of the sample

    def mean(self, numbers: Array) -> float:
        """Return the weighted mean of `numbers`, shape (m,), one for each value."""
        return float(self.weights @ numbers) / self.n

    def scaled(self, shift: float, scale: float) -> "BinnedSample":
        """Return the sample of ``(x - shift) / scale``, descending for a negative scale."""
        return BinnedSample((self.values - shift) / scale, self.weights, self.n)


def bin_sample(ordered: Array, most: int, shift: float = 0.0, scale: float = 1.0) -> BinnedSample:
    """Return ascending values as at most `most` weighted ones (a multiple of 4); a quarter are extremes at each end.

    They are the values of ``(x - shift) / scale``.
    """

    def scaled(part: Array) -> Array:
        return part if (shift, scale) == (0.0, 1.0) else (part - shift) / scale

    n = int(ordered.size)
    if n <= most:
        return BinnedSample(scaled(ordered), np.ones(n), n)
    tail = most // 4
    edges = np.linspace(tail, n - tail, most - 2 * tail + 1).astype(np.int64)
    sizes = np.diff(edges).astype(np.float64)
    # Sums of differences from a middle one, so that a large offset costs no digits.
    centre = float(scaled(ordered[n // 2 : n // 2 + 1])[0])
    total = np.empty(sizes.size)
    for at in range(0, sizes.size, _BLOCKS):  # so many at a time: no further column of millions is in memory
        part = edges[at : at + _BLOCKS + 1]
        total[at : at + _BLOCKS] = np.add.reduceat(scaled(ordered[part[0] : part[-1]]) - centre, part[:-1] - part[0])
    middle = centre + total / sizes
    values = np.concatenate((scaled(ordered[:tail]), middle, scaled(ordered[n - tail :])))
    return BinnedSample(values, np.concatenate((np.ones(tail), sizes, np.ones(tail))), n)


def distance(c: BinnedSample, cdf: Array) -> float:
    """Return Kolmogorov's distance: the largest difference of the sample's step function from `cdf` at its values."""
    below = (np.cumsum(c.weights) - c.weights + (c.weights - 1) / 2) / c.n
    return float(np.max(np.maximum(cdf - below, below + 1 / c.n - cdf)))


def anderson_darling(c: BinnedSample, cdf: Array, sf: Array) -> float | None:
    """Return A^2 (Anderson and Darling 1952), from `cdf` and `sf` at the values; None if an extreme is impossible."""
    if cdf[0] <= 0 or sf[-1] <= 0:
        return None
    last = np.cumsum(c.weights)
    first = last - c.weights
    of_cdf, of_sf = last**2 - first**2, (c.n - first) ** 2 - (c.n - last) ** 2
    return float(-c.n - (of_cdf @ np.log(cdf) + of_sf @ np.log(sf)) / c.n)
