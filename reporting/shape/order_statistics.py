"""Quantiles of the values themselves, and the bootstrap of whatever depends on a few of them.

A resample of n values is ``x[floor(n U)]`` of n uniform numbers, so its r-th smallest value is the one at the r-th
smallest U, and those few can be drawn directly: the distances between ordered uniform numbers are exponential, their
sums gamma. This is the ordinary bootstrap, exactly, at a cost that does not depend on n; no m-out-of-n is needed.
The quantiles at 0.135 % need values beyond them: an interval exists from `FEWEST` values on, where both ends of a
binomial interval of the percentile lie within the sample.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from reporting.arrays import Array
from reporting.capability.intervals import Interval

# ln 0.025 / ln 0.99865: from here on, both ends of a 95 % binomial interval of a 0.135 % percentile are in the sample.
FEWEST = 2731
_RESAMPLES = 4000
# A fixed seed: the same values always give the same report.
_SEED = 22514


def empirical_percentiles(ordered: Array, shares: Sequence[float]) -> Array:
    """Return the quantiles at ``p (n + 1)`` between neighbouring values (R's type 6), shape of `shares`.

    Parameters
    ----------
    ordered : array, shape (n,)
        Ascending.
    shares : sequence of float
        Between 0 and 1; beyond the first or last value the quantile is that value.
    """
    low, part = _ranks(ordered.size, shares)
    return _between(ordered[low - 1], ordered[np.minimum(low, ordered.size - 1)], part)


def percentile_bootstrap(
    ordered: Array,
    shares: Sequence[float],
    statistics: Callable[[Array], dict[str, Array]],
    confidence: float,
) -> dict[str, Interval]:
    """Return BCa intervals (Efron 1987) of statistics of a few percentiles.

    Parameters
    ----------
    ordered : array, shape (n,)
        Ascending, n at least `FEWEST`.
    shares : sequence of float, ascending
        Whose percentiles the statistics need.
    statistics : callable
        From percentiles of shape (shares, m) to named arrays of shape (m,).
    confidence : float
        Two-sided.
    """
    with np.errstate(all="ignore"):
        point = statistics(empirical_percentiles(ordered, shares)[:, None])
        draws = statistics(_resampled(ordered, shares))
        left_out, counts = _left_out(ordered, shares)
        influence = statistics(left_out)
    found = {}
    for name, drawn in draws.items():
        if np.all(np.isfinite(drawn)) and np.all(np.isfinite(influence[name])):
            found[name] = _bca(float(point[name][0]), drawn, influence[name], counts, confidence)
    return found


def _bca(point: float, drawn: Array, left_out: Array, counts: Array, confidence: float) -> Interval:
    """Return the interval, corrected for bias and for a spread that depends on the value."""
    share = (np.count_nonzero(drawn < point) + 0.5 * np.count_nonzero(drawn == point)) / drawn.size
    bias = float(ndtri(min(max(share, 1 / drawn.size), 1 - 1 / drawn.size)))
    moves = float(counts @ left_out) / float(counts.sum()) - left_out
    squares = float(counts @ moves**2)
    acceleration = float(counts @ moves**3) / (6 * squares**1.5) if squares > 0 else 0.0
    ends = []
    for z in (ndtri(0.5 - confidence / 2), ndtri(0.5 + confidence / 2)):
        ends.append(float(ndtr(bias + (bias + z) / (1 - acceleration * (bias + z)))))
    low, high = np.quantile(drawn, ends)
    return float(low), float(high)


def _ranks(n: int, shares: Sequence[float]) -> tuple[NDArray[np.int64], Array]:
    """Return the rank below each quantile, from 1, and the part of the way to the next."""
    place = np.clip(np.asarray(shares) * (n + 1), 1.0, float(n))
    low = np.floor(place).astype(np.int64)
    return low, place - low


def _between(low: Array, high: Array, part: Array) -> Array:
    return np.asarray(low + part * (high - low))


def _resampled(ordered: Array, shares: Sequence[float]) -> Array:
    """Return the percentiles of `_RESAMPLES` resamples, shape (shares, resamples)."""
    n = ordered.size
    low, part = _ranks(n, shares)
    ranks = np.unique(np.concatenate((low, np.minimum(low + 1, n))))
    steps = np.diff(np.concatenate(([0], ranks, [n + 1]))).astype(np.float64)
    sums = np.cumsum(np.random.default_rng(_SEED).gamma(steps[:, None], size=(steps.size, _RESAMPLES)), axis=0)
    at = np.minimum((n * sums[:-1] / sums[-1]).astype(np.int64), n - 1)
    values = ordered[at]
    first, second = np.searchsorted(ranks, low), np.searchsorted(ranks, np.minimum(low + 1, n))
    return _between(values[first], values[second], part[:, None])


def _left_out(ordered: Array, shares: Sequence[float]) -> tuple[Array, Array]:
    """Return the percentiles without one value, shape (shares, m), and for how many values each of the m stands.

    Between two ranks that matter it makes no difference which value is left out.
    """
    n = ordered.size
    low, part = _ranks(n - 1, shares)
    ends = np.unique(np.concatenate(([0], low, np.minimum(low + 1, n), [n])))
    counts = np.diff(ends).astype(np.float64)
    out = ends[1:]  # leaving out rank `out` stands for all ranks of its stretch
    first = ordered[low[:, None] - 1 + (out <= low[:, None])]
    second = ordered[np.minimum(low[:, None] + (out <= low[:, None] + 1), n - 1)]
    return _between(first, second, part[:, None]), counts
