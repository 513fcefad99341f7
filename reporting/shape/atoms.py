"""Repeated values: atoms, where a stop or a plateau collects a share of all values, and rounded values.

No density describes an atom: the likelihood of an ever narrower density grows without bound. Rounded values repeat too,
but about as often as their neighbours do.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import pdtrc

from reporting.arrays import Array

# Values closer than this part of their usual distance differ by rounding errors only.
_EQUAL = 1e-4
# An atom has this many times the values of its neighbours, more than occurs by chance in a thousand samples, and at
# least this share of all values.
_RATIO, _CHANCE, _LEAST_SHARE = 2.5, 1e-3, 0.01
# Number of neighbours on each side.
_REACH = 2
# A response with fewer different values than this is discrete.
FEWEST_VALUES = 10


@dataclass(frozen=True)
class Atom:
    """A value that a considerable share of all values has."""

    value: float  # in the unit of the values
    count: int
    share: float  # of all values
    where: str  # "lowest", "highest" or "inside": the smallest value, the largest, or one in between


@dataclass(frozen=True)
class Ties:
    """Distinct values and their counts."""

    values: Array  # ascending, shape (m,)
    counts: Array  # shape (m,)

    @property
    def discrete(self) -> bool:
        """Whether there are too few distinct values to be described by a density."""
        return self.values.size < FEWEST_VALUES and 2 * self.values.size < self.counts.sum()

    def atoms(self) -> tuple[Atom, ...]:
        """Return the atoms, the lowest first."""
        n, m = float(self.counts.sum()), self.values.size
        if m < 2 * _REACH or m == n:
            return ()
        usual = _neighbours(self.counts)
        # Without rounding all values are distinct: a count above one occurs by chance at the rate of the neighbours.
        rate = np.maximum(usual - 1 + np.sqrt(usual - 1), (n - m) / m)
        proven = (self.counts > 1) & (m * pdtrc(self.counts - 2, rate) < _CHANCE)
        end = np.isin(np.arange(m), (0, m - 1))
        found = np.flatnonzero(proven & (self.counts >= _RATIO * usual) & (end | (self.counts >= _LEAST_SHARE * n)))
        where = {0: "lowest", m - 1: "highest"}
        return tuple(
            Atom(float(self.values[i]), int(self.counts[i]), float(self.counts[i] / n), where.get(int(i), "inside"))
            for i in found
        )

    def spread(self) -> Array:
        """Return the values; equal ones are spread evenly over the range that rounds to them."""
        if self.values.size == self.counts.sum():
            return self.values
        gaps = np.diff(self.values) / 2
        half = np.minimum(np.append(gaps, gaps[-1]), np.append(gaps[0], gaps)) * (self.counts > 1)
        count = self.counts.astype(np.int64)
        place = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        across = (2 * place + 1) / np.repeat(self.counts, count) - 1
        return np.asarray(np.repeat(self.values, count) + across * np.repeat(half, count))


def ties(ordered: Array) -> Ties:
    """Return the distinct ones of ascending finite values, shape (n,), that are not all equal.

    Values that differ by rounding errors only are merged.
    """
    quarter, three_quarters = ordered[[ordered.size // 4, (3 * ordered.size) // 4]]
    # The range between quartiles, because a single distant value would inflate the usual distance.
    usual = float(three_quarters - quarter or ordered[-1] - ordered[0]) / ordered.size
    first = np.flatnonzero(np.append(True, np.diff(ordered) > _EQUAL * usual))
    last = np.append(first[1:], ordered.size)
    return Ties(ordered[(first + last - 1) // 2], (last - first).astype(np.float64))


def _neighbours(counts: Array) -> Array:
    """Return the mean count of the neighbours of each value."""
    padded = np.concatenate((np.zeros(_REACH), counts, np.zeros(_REACH)))
    present = np.concatenate((np.zeros(_REACH), np.ones(counts.size), np.zeros(_REACH)))
    moves = [k for k in range(2 * _REACH + 1) if k != _REACH]
    total = sum(padded[k : k + counts.size] for k in moves)
    return np.asarray(total / sum(present[k : k + counts.size] for k in moves))


def in_words(atom: Atom) -> str:
    """Return a description of an atom in one sentence."""
    percent = f"{100 * atom.share:.3g} % of the values ({atom.count}) are {atom.value:.6g}"
    if atom.where == "inside":
        return f"{percent}, a plateau or a preferred number."
    return f"{percent}, the {'smallest' if atom.where == 'lowest' else 'largest'} value: a stop or a plateau."
