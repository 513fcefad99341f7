"""Indices around a target that need not be the middle of the limits; one limit is enough.

All are divided by ``tau``, the root mean square around the target T: ``tau^2 = mean((x - T)^2)``, divisor n.

- Cpm* is ``min(USL - T, T - LSL) / (3 tau)`` (Chan, Cheng, Spiring 1988): the nearer limit counts, so Cpm* equals Cpm
  if the target is the middle, and is smaller otherwise. With one limit it is the index of that side, as in Minitab.
- Cpmk is ``min(USL - m, m - LSL) / (3 tau)`` (Pearn, Kotz, Johnson 1992), also named Cpkm; with one limit it is the
  index of that side, ``C_pa(0, 1)`` of Vännman (1998). With two limits it is ``Cpk Cpm / Cp``.

The interval of Cpm* is that of Cpm with limits as far from the target as the nearer limit
(`reporting.capability.interval_choice`). The interval of Cpmk follows from its influence function, with Student's
quantile for the degrees of freedom of its spread. Measured coverage of 95 % intervals of Cpmk at n = 500 and 5,000,
target 0 and 0.7 sigma off, for six shapes: 91 to 97 %; at n = 50: 84 to 95 %, so it is given for 100 values or more.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from reporting.arrays import Array
from reporting.capability.indices import distance_to_limit
from reporting.capability.interval_choice import Fence, choose_method, index_intervals
from reporting.capability.intervals import Interval
from reporting.capability.lots import FEW_LOTS, describe_lots, independent, lot_error
from reporting.capability.moments import ROUNDING, location_and_shape

FEWEST_FOR_CPMK = 100  # and 20 effective lots: with 5 lots a 95 % interval covers 87 %
# Floor of the spread of squares: at its lower bound 0 a variance would be exact, which a few values cannot prove.
_LEAST_SPREAD = 0.2
_LEAST_FREEDOM = 2.0


@dataclass(frozen=True)
class TargetIndices:
    """Indices around a target."""

    tau: float  # root mean square around the target, in the unit of the response
    cpm_star: float
    cpm_star_interval: Interval | None  # None where it is withheld
    cpmk: float
    cpmk_interval: Interval | None  # None where it is withheld, and below 100 values


def target_indices(
    x: Array,
    lsl: float | None,
    usl: float | None,
    target: float | None,
    confidence: float,
    lots: NDArray[np.generic] | None = None,
) -> TargetIndices | None:
    """Return the indices around a target; None without a target between the limits, or without spread around it.

    One limit is enough. Without `lots`, shape (n,), all finite values `x` are independent.
    """
    if target is None or x.size < 2 or (lsl is None and usl is None):
        return None
    room = distance_to_limit(target, lsl, usl)
    with np.errstate(over="ignore", invalid="ignore"):  # squares of values near the largest double overflow
        mean, tau = float(np.mean(x)), math.sqrt(float(np.mean((x - target) ** 2)))
    if room <= 0 or not ROUNDING * max(abs(target), float(np.max(np.abs(x)))) < tau < math.inf:
        return None
    shape = location_and_shape(x)
    cpm_star, cpmk = room / (3 * tau), distance_to_limit(mean, lsl, usl) / (3 * tau)
    of_cpm, of_cpmk = None, None
    if shape.get("std", 0.0) > 0:
        lots = None if lots is None or independent(lots) else lots
        kurtosis = shape.get("kurtosis")
        described = None if lots is None else describe_lots(x, lots)
        method = choose_method(x, kurtosis, described)
        around = Fence(target - room, target + room, target, confidence)
        of_cpm = index_intervals(method, x, kurtosis, around, lots).get("cpm_interval")
        side = 1.0 if usl is None or (lsl is not None and mean - lsl < usl - mean) else -1.0
        influence = side * (x - mean) / (3 * tau) - cpmk * (((x - target) / tau) ** 2 - 1) / 2
        enough = x.size >= FEWEST_FOR_CPMK and (described is None or round(described.worth) >= FEW_LOTS)
        if method.name and enough:
            half = _half_width(influence, lots, confidence)
            of_cpmk = (cpmk - half, cpmk + half)
    return TargetIndices(tau, cpm_star, _finite(of_cpm), cpmk, _finite(of_cpmk))


def _finite(interval: Interval | None) -> Interval | None:
    """Return an interval with finite ends; None if an end is not finite."""
    return interval if interval is not None and all(map(math.isfinite, interval)) else None


def _half_width(influence: Array, lots: NDArray[np.generic] | None, confidence: float) -> float:
    """Return half the width of the interval of an index with this influence function."""
    n = influence.size
    error, freedom = lot_error(influence, np.full(n, 1 / n), lots)
    spread = float(np.mean(influence**4)) / float(np.mean(influence**2)) ** 2 - 1
    known = min(max(2 * n / max(spread, _LEAST_SPREAD), _LEAST_FREEDOM), freedom)
    return float(stdtrit(known, 0.5 + confidence / 2)) * error
