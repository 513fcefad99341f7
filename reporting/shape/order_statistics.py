"""Ranks, empirical quantiles, and statistics of a few quantiles, with exact intervals.

The number of values below a quantile of the true distribution is binomial, so two ordered values enclose the quantile
with a known probability, whatever the distribution (David, Nagaraja, Order Statistics, section 7.1). A quantile at
0.135 % needs values beyond it: with at least `FEWEST` values both ends of its interval lie within the sample.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtr

from reporting.arrays import Array
from reporting.capability.intervals import Interval

# ln 0.025 / ln 0.99865.
FEWEST = 2731


def empirical_percentiles(ordered: Array, shares: Sequence[float]) -> Array:
    """Return the quantiles at the ranks ``p (n + 1)``, interpolated between neighbours (R's type 6).

    The values are ascending, shape (n,); a rank beyond the first or last value gives that value.
    """
    low, part = _ranks(ordered.size, shares)
    return _between(ordered[low - 1], ordered[np.minimum(low, ordered.size - 1)], part)


def quantile_interval(ordered: Array, share: float, confidence: float) -> Interval | None:
    """Return the two of the ascending values that enclose a quantile; None if the sample is too small for them.

    Each end misses the quantile with a probability of at most ``(1 - confidence) / 2``.
    """
    n, miss = ordered.size, (1 - confidence) / 2
    # Ten standard deviations hold every rank that an end can have, and spare the binomial sums of all n.
    spread = 10 * np.sqrt(n * share * (1 - share)) + 10
    rank = np.arange(max(int(n * share - spread), 0), min(int(n * share + spread), n) + 1)
    below = bdtr(rank.astype(np.float64), n, share)  # probability of at most `rank` values below the quantile
    low = int(rank[np.searchsorted(below, miss, side="right")])
    high = int(rank[np.searchsorted(below, 1 - miss)]) + 1
    if low < 1 or high > n:
        return None
    return float(ordered[low - 1]), float(ordered[high - 1])


def interval_of_quantiles(
    ordered: Array,
    shares: Sequence[float],
    statistics: Callable[[Array], dict[str, float]],
    confidence: float,
) -> dict[str, Interval]:
    """Return intervals of `statistics` of a few quantiles, by name; empty if the sample is too small.

    Each quantile is moved alone to both ends of its interval; the resulting changes of a statistic add as squares,
    upward and downward changes separately (Zou, Donner 2008).
    """
    ends = [quantile_interval(ordered, share, confidence) for share in shares]
    middle = empirical_percentiles(ordered, shares)
    point = statistics(middle)
    down, up = dict.fromkeys(point, 0.0), dict.fromkeys(point, 0.0)
    for i, pair in enumerate(ends):
        if pair is None:
            return {}
        for end in pair:
            moved = statistics(np.where(np.arange(middle.size) == i, end, middle))
            for name, value in point.items():
                move = float(moved[name] - value)
                down[name], up[name] = down[name] + min(move, 0.0) ** 2, up[name] + max(move, 0.0) ** 2
    found = {name: (float(v - np.sqrt(down[name])), float(v + np.sqrt(up[name]))) for name, v in point.items()}
    return {name: interval for name, interval in found.items() if np.all(np.isfinite(interval))}


def _ranks(n: int, shares: Sequence[float]) -> tuple[NDArray[np.int64], Array]:
    """Return the rank below each quantile, counted from 1, and the fraction of the distance to the next rank."""
    rank = np.clip(np.asarray(shares) * (n + 1), 1.0, float(n))
    low = np.floor(rank).astype(np.int64)
    return low, rank - low


def _between(low: Array, high: Array, part: Array) -> Array:
    """Return values interpolated between `low` and `high`."""
    return np.asarray(low + part * (high - low))
