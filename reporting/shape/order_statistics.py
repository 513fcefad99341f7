"""Ranks, quantiles of the values themselves, and the bootstrap of statistics of a few quantiles.

A resample of n values is ``x[floor(n U)]`` for n uniform numbers U, so its r-th smallest value belongs to the r-th
smallest U. Those few can be drawn directly, because the distances between ordered uniform numbers are exponential and
their sums gamma (David, Nagaraja, Order Statistics, section 2.1). This is the ordinary bootstrap, exactly, at a cost
that does not depend on n. A quantile at 0.135 % needs values beyond it: there is an interval from `FEWEST` values on,
where both ends of a binomial interval of the percentile lie within the sample.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from reporting.arrays import Array
from reporting.capability.intervals import Interval

# ln 0.025 / ln 0.99865.
FEWEST = 2731
_RESAMPLES = 4000
# Fixed, so that the same values always give the same report.
_SEED = 22514


def centred_ranks(values: Array) -> Array:
    """Return the ranks of values less their mean; equal values have their middle rank.

    Parameters
    ----------
    values : array, shape (n,)

    Returns
    -------
    array, shape (n,)
    """
    from scipy.stats import rankdata  # takes 1 s to import, which `import reporting` avoids

    return np.asarray(rankdata(values) - 0.5 * (values.size + 1))


def empirical_percentiles(ordered: Array, shares: Sequence[float]) -> Array:
    """Return the quantiles at the ranks ``p (n + 1)``, interpolated between neighbours (R's type 6).

    Parameters
    ----------
    ordered : array, shape (n,)
        Ascending.
    shares : sequence of float
        Probabilities p between 0 and 1; beyond the first or last value the quantile is that value.
    """
    low, part = _ranks(ordered.size, shares)
    return _between(ordered[low - 1], ordered[np.minimum(low, ordered.size - 1)], part)


def percentile_bootstrap(
    ordered: Array,
    shares: Sequence[float],
    statistics: Callable[[Array], dict[str, Array]],
    confidence: float,
) -> dict[str, Interval]:
    """Return bias-corrected and accelerated bootstrap intervals (Efron 1987) of statistics of a few percentiles.

    Parameters
    ----------
    ordered : array, shape (n,)
        Ascending, n at least `FEWEST`.
    shares : sequence of float, ascending
        Probabilities of the percentiles that the statistics need.
    statistics : callable
        From percentiles of shape (shares, m) to named arrays of shape (m,).
    confidence : float
        Two-sided.

    Returns
    -------
    dict of str to (float, float)
        By name of the statistic; one that is not finite in a resample has no interval.
    """
    with np.errstate(all="ignore"):
        point = statistics(empirical_percentiles(ordered, shares)[:, None])
        draws = statistics(_resampled(ordered, shares))
        left_out, counts = _left_out(ordered, shares)
        influence = statistics(left_out)
    intervals = {}
    for name, drawn in draws.items():
        if np.all(np.isfinite(drawn)) and np.all(np.isfinite(influence[name])):
            intervals[name] = _bca(float(point[name][0]), drawn, influence[name], counts, confidence)
    return intervals


def _bca(point: float, drawn: Array, left_out: Array, counts: Array, confidence: float) -> Interval:
    """Return the interval, corrected for bias and for a variance that depends on the parameter."""
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
    """Return the rank below each quantile, from 1, and the fraction of the distance to the next rank."""
    rank = np.clip(np.asarray(shares) * (n + 1), 1.0, float(n))
    low = np.floor(rank).astype(np.int64)
    return low, rank - low


def _between(low: Array, high: Array, part: Array) -> Array:
    """Return values interpolated between `low` and `high`."""
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
    """Return the percentiles of the sample without one value, shape (shares, m), and the number of such values.

    Between two ranks that the percentiles use it makes no difference which value is left out: m cases cover all n.
    """
    n = ordered.size
    low, part = _ranks(n - 1, shares)
    ends = np.unique(np.concatenate(([0], low, np.minimum(low + 1, n), [n])))
    counts = np.diff(ends).astype(np.float64)
    out = ends[1:]  # the rank left out, for all ranks of its range
    first = ordered[low[:, None] - 1 + (out <= low[:, None])]
    second = ordered[np.minimum(low[:, None] + (out <= low[:, None] + 1), n - 1)]
    return _between(first, second, part[:, None]), counts
