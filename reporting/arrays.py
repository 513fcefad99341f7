"""The type of the report's arrays, what of them is rounding, their ranks, Gauss's points, a random order of rows."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# The standard error of a share is below 0.002 with this many rows; more rows would not change a printed digit.
MOST_ROWS = 200_000
# A spread below this share of the largest value is rounding error: the values are a constant. A sum over some thousand
# steps loses about this many of the last bits.
ROUNDING = 1e-12


@lru_cache(maxsize=8)
def gauss_legendre(count: int) -> tuple[Array, Array]:
    """Return the Gauss-Legendre points and weights on [-1, 1]."""
    points, weights = np.polynomial.legendre.leggauss(count)
    return points, weights


@lru_cache(maxsize=32)
def random_rows(n: int) -> NDArray[np.intp]:
    """Return the indices of at most 200,000 of `n` rows in random order; the order is the same for the same `n`.

    Consecutive samples of a Sobol' sequence or a grid are not independent; groups in random order represent all rows.
    """
    rows = np.random.Generator(np.random.PCG64(n)).permutation(n)[:MOST_ROWS].copy()
    rows.flags.writeable = False  # others get the same array
    return rows


def centred_ranks(values: Array) -> Array:
    """Return the ranks of finite values less their mean, shape (n,); equal values have their middle rank."""
    order = np.argsort(values)
    ordered = values[order]
    first = np.flatnonzero(np.append(True, ordered[1:] > ordered[:-1])) if values.size else np.zeros(0, np.intp)
    counts = np.diff(np.append(first, values.size))
    ranks = np.empty(values.size)
    # The middle of the ranks that equal values share; the first rank is 1.
    ranks[order] = np.repeat(first + 0.5 * (counts + 1), counts)
    return ranks - 0.5 * (values.size + 1)
