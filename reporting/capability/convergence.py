"""Convergence of an index with the number of samples, and agreement of the two halves of a campaign."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtr

from reporting.arrays import Array
from reporting.capability.indices import cpk, cpk_influence
from reporting.capability.interval_choice import NORMAL, Fence, choose_method, precision_by
from reporting.capability.intervals import cpk_half_width, mean_interval
from reporting.capability.lots import describe_lots, independent, lot_error
from reporting.capability.moments import ROUNDING, location_and_shape
from reporting.capability.robust_intervals import robust_intervals

_POINTS, _FIRST = 60, 10
# Halves of a campaign that differ by more standard errors than this do not come from one distribution.
DRIFT_BAR = 4.0


@dataclass(frozen=True)
class Convergence:
    """An index over the first n samples, for increasing n."""

    index: str  # "Cpk", or "mean" without limits
    n: tuple[int, ...]  # numbers of samples, rising
    value: tuple[float, ...]  # of the first n samples; a mean is in the response's unit
    low: tuple[float, ...]  # ends of the interval by the method that is valid for the first n samples
    high: tuple[float, ...]
    # Index of the second half of the samples minus that of the first, in standard errors (delta method, any
    # distribution; with few lots, the normal quantile of the same probability). None below 40 samples, or where a half
    # has fewer than two lots.
    drift: float | None


def convergence(
    x: Array, lsl: float | None, usl: float | None, confidence: float, lots: NDArray[np.generic] | None = None
) -> Convergence | None:
    """Return how the index of finite values in order converges; None below 10, without spread or with too few lots."""
    n = x.size
    if n < _FIRST or float(np.std(x)) <= ROUNDING * float(np.max(np.abs(x))):
        return None
    lots = None if independent(lots) else lots
    name = "mean" if lsl is None and usl is None else "cpk"
    points = []
    # At equal ratios of n: the figure's axis is logarithmic, and a long campaign costs no more points.
    for count in np.unique(np.geomspace(_FIRST, n, _POINTS).astype(np.int64)).tolist():
        found = _point(x[:count], Fence(lsl, usl, None, confidence), None if lots is None else lots[:count], name)
        if found is not None:
            points.append((count, *found))
    if not points:
        return None
    n_first, value, low, high = zip(*points, strict=True)
    return Convergence("mean" if name == "mean" else "Cpk", n_first, value, low, high, drift(x, lsl, usl, lots))


def _point(x: Array, fence: Fence, lots: NDArray[np.generic] | None, name: str) -> tuple[float, float, float] | None:
    """Return an index of the values and its interval; None without spread or with too few lots."""
    numbers = location_and_shape(x)
    if numbers["std"] == 0:
        return None
    mean, std, kurtosis = numbers["mean"], numbers["std"], numbers.get("kurtosis")
    value = mean if name == "mean" else cpk(mean, std, fence.lsl, fence.usl)
    method = choose_method(x, kurtosis, None if lots is None else describe_lots(x, lots))
    if method.name == NORMAL:
        half = cpk_half_width(value, x.size, fence.confidence)
        return value, *(
            mean_interval(mean, std, x.size, fence.confidence) if name == "mean" else (value - half, value + half)
        )
    precision = precision_by(method, x, kurtosis, lots, fence.confidence)
    interval = (
        None if precision is None else robust_intervals(precision, fence.lsl, fence.usl, None)[f"{name}_interval"]
    )
    return None if interval is None else (value, *interval)


def drift(x: Array, lsl: float | None, usl: float | None, lots: NDArray[np.generic] | None) -> float | None:
    """Return the difference of the index between the halves in standard errors; see `Convergence.drift`."""
    half = x.size // 2
    if lots is not None:  # a lot in both halves would hide a difference between them: where one ends, or nowhere
        begins = np.flatnonzero(lots[1:] != lots[:-1]) + 1
        half = int(begins[np.argmin(np.abs(begins - half))]) if begins.size else 0
    if half < 2 * _FIRST or x.size - half < 2 * _FIRST:
        return None
    (first, error, freedom), (second, other, of_other) = (
        _with_error(x[part], lsl, usl, None if lots is None else lots[part])
        for part in (slice(half), slice(half, None))
    )
    both = math.hypot(error, other)
    if not 0 < both < math.inf:
        return None
    errors = (second - first) / both
    if math.isinf(freedom) and math.isinf(of_other):
        return errors
    # Few lots know their error badly. The bar is in normal standard errors, so Student's tail is converted.
    welch = both**4 / (error**4 / freedom + other**4 / of_other)
    # Not 0: its normal quantile would be infinite.
    tail = max(float(stdtr(welch, -abs(errors))), math.ulp(0.0))
    return math.copysign(float(ndtri(tail)), errors)


def _with_error(
    x: Array, lsl: float | None, usl: float | None, lots: NDArray[np.generic] | None
) -> tuple[float, float, float]:
    """Return the index of values, its standard error and the degrees of freedom of the error."""
    mean, std = float(np.mean(x)), float(np.std(x))
    weight = np.full(x.size, 1 / x.size)
    if std == 0 or (lsl is None and usl is None):
        return mean, *lot_error(x - mean, weight, lots)
    index = cpk(mean, std, lsl, usl)
    lower = usl is None or (lsl is not None and mean - lsl < usl - mean)
    return index, *lot_error(cpk_influence(x, index, lower=lower), weight, lots)
