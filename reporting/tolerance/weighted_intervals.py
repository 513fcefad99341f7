"""Intervals of weighted means and shares that allow for unobserved samples of large weight.

A few samples of large weight dominate a weighted mean, and such samples that were not drawn are missing in it. Every
interval therefore includes one more sample as influential as the most influential one (as Fay and Feuer 1997 do for
shares). Its width is that of Student's t with the degrees of freedom of the variance of the contributions
(Satterthwaite), and its ends are corrected for the skewness of the contributions by the monotone cubic transformation
of Hall (1992).
"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv, stdtrit

from reporting.arrays import Array
from reporting.capability.intervals import Interval

# The skewness of samples is smaller than that of their distribution. With this factor 95 % intervals of mean, sigma and
# Cpk covered 90 to 100 % in campaigns of 500 and 5,000 samples with one sigma multiplied by 0.5 to 1.3; with the factor
# 1, 79 to 99 %.
UNSEEN_SKEWNESS = 1.5
_LEAST_FREEDOM = 2.0

LotLabels = NDArray[np.generic]


def by_lot(terms: Array, lots: LotLabels | None) -> Array:
    """Return independent terms: the terms of one lot share a shift and are added."""
    if lots is None:
        return terms
    _, group = np.unique(lots, return_inverse=True)
    return np.asarray(np.bincount(group, weights=terms), np.float64)


def variance_of_sum(terms: Array) -> float:
    """Return the variance of the sum of independent terms whose expectations add up to zero; infinite for one term."""
    return _variance(float(np.sum(terms**2)), terms.size)


def _variance(squares: float, count: int) -> float:
    """Return the variance of the sum of `count` terms from the sum of their squares."""
    return math.inf if count < 2 else count / (count - 1) * squares


def mean_interval(value: float, terms: Array, confidence: float) -> Interval:
    """Return the two-sided interval of an estimate from its influence function.

    `terms`, shape (m,), are the contributions of each independent sample, or lot, to the error of the estimate: weight
    times influence function.
    """
    squares = float(np.sum(terms**2))
    variance = _variance(squares, terms.size)
    if variance == 0:
        return value, value
    if not math.isfinite(variance):
        return -math.inf, math.inf
    scaled = terms / math.sqrt(squares)
    most = float(scaled[np.argmax(np.abs(scaled))])
    squared = scaled * scaled
    second, third, fourth = 1 + most**2, float(np.sum(squared * scaled)) + most**3, float(np.sum(squared**2)) + most**4
    spread_of_second = fourth - second**2 / (terms.size + 1)
    freedom = 2 * second**2 / spread_of_second if spread_of_second > 0 else float(terms.size)
    t = float(stdtrit(min(max(freedom, _LEAST_FREEDOM), terms.size - 1), 0.5 + confidence / 2))
    skewness = UNSEEN_SKEWNESS * third / second**1.5
    error = math.sqrt(variance * second)
    return value - error * _hall(t, skewness), value - error * _hall(-t, skewness)


def share_interval(is_out: NDArray[np.bool_], weight: Array, lots: LotLabels | None, confidence: float) -> Interval:
    """Return the two-sided interval of a weighted share; the weights sum to 1.

    With equal weights it is the interval of Clopper and Pearson. If no sample is out, it is their interval for a number
    of samples of 1 divided by the largest weight.
    """
    upper = 0.5 + confidence / 2
    share = min(float(np.sum(weight[is_out])), 1.0)
    variance = float(np.sum(weight[is_out] ** 2))
    largest = float(weight.max())
    if lots is not None:
        weights, counted = by_lot(weight, lots), by_lot(np.where(is_out, weight, 0.0), lots)
        if counted.size < 2:
            return 0.0, 1.0
        largest = float(weights.max())
        widened = float(stdtrit(counted.size - 1, upper) / stdtrit(weight.size - 1, upper)) ** 2
        variance = max(variance, float(np.sum(counted**2))) * widened
    low = 0.0 if share <= 0 else _beta(share, variance, 1 - upper)
    return low, _beta(share + largest, variance + largest**2, upper)


def _beta(share: float, variance: float, p: float) -> float:
    """Return a quantile of the beta distribution for a share counted with this variance."""
    if share >= 1 or variance == 0:  # squares of tiny weights underflow, and the share is zero
        return min(math.floor(share), 1.0)
    count = share**2 / variance
    return float(betaincinv(count, share / variance + 1 - count, p))


def _hall(x: float, skewness: float) -> float:
    """Return the quantile of a studentised mean, corrected for the skewness of the sum."""
    if abs(skewness) < 1e-9:
        return x
    return float((np.cbrt(1 + skewness * (x - skewness / 6)) - 1) / (skewness / 3))
