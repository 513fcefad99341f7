"""How an index converges as samples come in, and whether the two halves of a campaign agree."""

import math
from dataclasses import dataclass

import numpy as np

from reporting.arrays import Array
from reporting.capability.indices import cpk, cpk_standard_error
from reporting.capability.intervals import cpk_half_width, mean_interval
from reporting.capability.moments import ROUNDING

_POINTS, _FIRST = 60, 10
# Halves of a campaign that differ by more standard errors do not come from one distribution.
DRIFT_BAR = 4.0


@dataclass(frozen=True)
class Convergence:
    """An index over the first n samples, for rising n.

    Attributes
    ----------
    index : str
        "Cpk", or "mean" without limits.
    n : tuple of int
        Numbers of samples.
    value, low, high : tuple of float
        The index over the first n samples and its interval (Bissell; Student for a mean, in the response's unit).
    drift : float or None
        Index of the second half of the samples less that of the first, in standard errors (delta method, any
        distribution); None below 40 samples.
    """

    index: str
    n: tuple[int, ...]
    value: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    drift: float | None


def convergence(x: Array, lsl: float | None, usl: float | None, confidence: float) -> Convergence | None:
    """Return how the index of a response converges; None below 10 values or without spread.

    Parameters
    ----------
    x : array, shape (n,)
        Finite values in the order of the samples.
    lsl, usl : float or None
        Limits.
    confidence : float
        Of the band, two-sided.
    """
    n = x.size
    if n < _FIRST or float(np.std(x)) <= ROUNDING * float(np.max(np.abs(x))):
        return None
    counts = np.unique(np.geomspace(_FIRST, n, _POINTS).astype(np.int64))
    origin = float(np.mean(x))  # sums of squares of a large offset would lose the digits of the spread
    mean = np.cumsum(x - origin)[counts - 1] / counts
    square = np.cumsum((x - origin) ** 2)[counts - 1] / counts - mean**2
    std = np.sqrt(np.maximum(square, 0.0) * counts / (counts - 1))
    limited = lsl is not None or usl is not None
    points = []
    for count, m, s in zip(counts.tolist(), (mean + origin).tolist(), std.tolist(), strict=True):
        if not limited:
            points.append((count, m, *mean_interval(m, s, count, confidence)))
        elif s > 0:
            index = cpk(m, s, lsl, usl)
            half = cpk_half_width(index, count, confidence)
            points.append((count, index, index - half, index + half))
    if not points:
        return None
    n_first, value, low, high = zip(*points, strict=True)
    return Convergence("Cpk" if limited else "mean", n_first, value, low, high, _drift(x, lsl, usl))


def _drift(x: Array, lsl: float | None, usl: float | None) -> float | None:
    """Return the difference of the index between the halves, in standard errors."""
    half = x.size // 2
    if half < 2 * _FIRST:
        return None
    (first, error), (second, other) = _with_error(x[:half], lsl, usl), _with_error(x[half:], lsl, usl)
    both = math.hypot(error, other)
    return (second - first) / both if both > 0 else None


def _with_error(x: Array, lsl: float | None, usl: float | None) -> tuple[float, float]:
    """Return the index of values and its standard error."""
    mean, std = float(np.mean(x)), float(np.std(x))
    if std == 0 or (lsl is None and usl is None):
        return mean, std / math.sqrt(x.size)
    index = cpk(mean, std, lsl, usl)
    lower = usl is None or (lsl is not None and mean - lsl < usl - mean)
    return index, cpk_standard_error(x, index, lower=lower)
