"""A large sorted sample binned to a few hundred or thousand weighted values.

Both tails are kept unchanged, because they decide a capability; between them neighbours are averaged in blocks. The
error of a sum of a smooth function is of second order in the width of a block: a few tenths of a unit of
log-likelihood for a million values, nearly the same for every family.
"""

from dataclasses import dataclass

import numpy as np

from reporting.arrays import Array


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


def bin_sample(ordered: Array, most: int) -> BinnedSample:
    """Return ascending values as at most `most` weighted ones (a multiple of 4); a quarter are extremes at each end."""
    n = int(ordered.size)
    if n <= most:
        return BinnedSample(ordered, np.ones(n), n)
    tail = most // 4
    edges = np.linspace(tail, n - tail, most - 2 * tail + 1).astype(np.int64)
    sizes = np.diff(edges).astype(np.float64)
    centre = float(ordered[n // 2])  # sums of differences, so that a large offset costs no digits
    middle = centre + np.add.reduceat(ordered[: n - tail] - centre, edges[:-1]) / sizes
    values = np.concatenate((ordered[:tail], middle, ordered[n - tail :]))
    return BinnedSample(values, np.concatenate((np.ones(tail), sizes, np.ones(tail))), n)


def distance(c: BinnedSample, cdf: Array) -> float:
    """Return Kolmogorov's distance: the largest difference of the sample's step function from `cdf` at its values."""
    below = (np.cumsum(c.weights) - c.weights + (c.weights - 1) / 2) / c.n
    return float(np.max(np.maximum(cdf - below, below + 1 / c.n - cdf)))


def anderson_darling(c: BinnedSample, cdf: Array, sf: Array) -> float | None:
    """Return the statistic A^2 of Anderson and Darling (1952); None if the distribution excludes an extreme value.

    `cdf` and its complement `sf` are those of the distribution at the values, shape (m,).
    """
    if cdf[0] <= 0 or sf[-1] <= 0:
        return None
    last = np.cumsum(c.weights)
    first = last - c.weights
    of_cdf, of_sf = last**2 - first**2, (c.n - first) ** 2 - (c.n - last) ** 2
    return float(-c.n - (of_cdf @ np.log(cdf) + of_sf @ np.log(sf)) / c.n)
