"""How an index settles while samples come in, and whether it still moves."""

import math
from dataclasses import dataclass

import numpy as np

from reporting.arrays import Array
from reporting.capability.intervals import cpk_half_width, mean_interval
from reporting.capability.moments import ROUNDING

_POINTS, _FIRST = 60, 10
# Halves of a campaign that differ by so many standard errors do not come from one source.
DRIFT_BAR = 4.0


@dataclass(frozen=True)
class Convergence:
    """An index over the first n samples.

    Attributes
    ----------
    index : str
        "Cpk", or "mean" where there are no limits.
    n : tuple of int
        Numbers of samples.
    value, low, high : tuple of float
        The index of so many samples and its interval (Bissell; Student), in the response's unit for a mean.
    drift : float or None
        Difference of the index between second and first half of the samples, in its standard errors (delta method,
        any distribution); None below 40 samples.
    """

    index: str
    n: tuple[int, ...]
    value: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    drift: float | None


def convergence(x: Array, lsl: float | None, usl: float | None, confidence: float) -> Convergence | None:
    """Return how the index of a response settles; None below 10 values or without spread.

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
    at = np.unique(np.geomspace(_FIRST, n, _POINTS).astype(np.int64))
    origin = float(np.mean(x))  # a large offset would eat the digits of the spread
    mean = np.cumsum(x - origin)[at - 1] / at
    square = np.cumsum((x - origin) ** 2)[at - 1] / at - mean**2
    std = np.sqrt(np.maximum(square, 0.0) * at / (at - 1))
    limited = lsl is not None or usl is not None
    points = []
    for count, m, s in zip(at.tolist(), (mean + origin).tolist(), std.tolist(), strict=True):
        if not limited:
            points.append((count, m, *mean_interval(m, s, count, confidence)))
        elif s > 0:
            cpk = _cpk(m, s, lsl, usl)
            half = cpk_half_width(cpk, count, confidence)
            points.append((count, cpk, cpk - half, cpk + half))
    if not points:
        return None
    counts, values, low, high = zip(*points, strict=True)
    return Convergence("Cpk" if limited else "mean", counts, values, low, high, _drift(x, lsl, usl))


def _cpk(mean: float, std: float, lsl: float | None, usl: float | None) -> float:
    """Return Cpk of a mean and a sigma."""
    sides = [] if lsl is None else [(mean - lsl) / (3 * std)]
    sides += [] if usl is None else [(usl - mean) / (3 * std)]
    return min(sides)


def _drift(x: Array, lsl: float | None, usl: float | None) -> float | None:
    """Return the difference of the index between the halves, in standard errors."""
    half = x.size // 2
    if half < 2 * _FIRST:
        return None
    (first, error), (second, other) = _with_error(x[:half], lsl, usl), _with_error(x[half:], lsl, usl)
    together = math.hypot(error, other)
    return (second - first) / together if together > 0 else None


def _with_error(x: Array, lsl: float | None, usl: float | None) -> tuple[float, float]:
    """Return the index of values and its standard error, from its influence function."""
    mean, std = float(np.mean(x)), float(np.std(x))
    off = x - mean
    if std == 0 or (lsl is None and usl is None):
        return mean, std / math.sqrt(x.size)
    index = _cpk(mean, std, lsl, usl)
    below = usl is None or (lsl is not None and mean - lsl < usl - mean)
    influence = ((1 if below else -1) * off / 3 - index * (off**2 - std**2) / (2 * std)) / std
    return index, float(np.sqrt(np.mean(influence**2) / x.size))
