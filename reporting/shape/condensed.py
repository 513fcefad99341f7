"""A large sorted sample in a few thousand weighted values, for everything that costs by the value.

Both tails stay as they are, because the tails decide a capability; between them neighbours are averaged. A block of
neighbours is so narrow that the error of a smooth sum is of second order in its width: a few tenths of a unit of
log-likelihood at a million values, nearly the same for every family.
"""

from dataclasses import dataclass

import numpy as np

from reporting.arrays import Array


@dataclass(frozen=True)
class Condensed:
    """Values that stand for a sorted sample.

    Attributes
    ----------
    values : array, shape (m,)
        Ascending.
    weights : array, shape (m,)
        How many values of the sample each stands for; they sum to n.
    n : int
        Size of the sample.
    """

    values: Array
    weights: Array
    n: int

    def mean(self, of: Array) -> float:
        """Return the weighted mean of numbers that belong to the values, shape (m,)."""
        return float(self.weights @ of) / self.n

    def scaled(self, shift: float, scale: float) -> "Condensed":
        """Return the same sample of ``(x - shift) / scale``; for a negative scale in falling order."""
        return Condensed((self.values - shift) / scale, self.weights, self.n)


def condense(ordered: Array, most: int) -> Condensed:
    """Return at most `most` weighted values for a sample: a quarter of them the extremes at each end.

    Parameters
    ----------
    ordered : array, shape (n,)
        Ascending finite values.
    most : int
        A multiple of 4.
    """
    n = int(ordered.size)
    if n <= most:
        return Condensed(ordered, np.ones(n), n)
    tail = most // 4
    edges = np.linspace(tail, n - tail, most - 2 * tail + 1).astype(np.int64)
    sizes = np.diff(edges).astype(np.float64)
    centre = float(ordered[n // 2])  # sums of differences: a huge offset costs no digits
    middle = centre + np.add.reduceat(ordered[: n - tail] - centre, edges[:-1]) / sizes
    values = np.concatenate((ordered[:tail], middle, ordered[n - tail :]))
    return Condensed(values, np.concatenate((np.ones(tail), sizes, np.ones(tail))), n)


def distance(c: Condensed, cdf: Array) -> float:
    """Return the largest difference of the sample's step function and `cdf` at its values (Kolmogorov)."""
    below = (np.cumsum(c.weights) - c.weights + (c.weights - 1) / 2) / c.n
    return float(np.max(np.maximum(cdf - below, below + 1 / c.n - cdf)))


def anderson_darling(c: Condensed, cdf: Array, sf: Array) -> float | None:
    """Return the statistic A^2 of Anderson and Darling (1952); None if a value has probability zero.

    Parameters
    ----------
    c : Condensed
    cdf, sf : array, shape (m,)
        Distribution function at its values, and its complement.
    """
    if cdf[0] <= 0 or sf[-1] <= 0:
        return None
    last = np.cumsum(c.weights)
    first = last - c.weights
    of_cdf, of_sf = last**2 - first**2, (c.n - first) ** 2 - (c.n - last) ** 2
    return float(-c.n - (of_cdf @ np.log(cdf) + of_sf @ np.log(sf)) / c.n)
