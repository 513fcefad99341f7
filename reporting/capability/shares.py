"""Non-conforming shares: the count, its confidence bound, and the number of runs that a claim requires.

Bounds of counts are exact binomial bounds (Clopper and Pearson 1934): no distribution of the response is assumed.
"""

import math
from bisect import bisect_left
from dataclasses import dataclass
from numbers import Integral

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv, log_ndtr, ndtr, ndtri

from reporting.arrays import Array
from reporting.capability.intervals import Interval, share_interval, share_upper_bound
from reporting.capability.lots import describe_lots, design_effect, independent
from reporting.errors import ReportError, real_number

PPM = 1e6
# A model fitted to n values is not extrapolated beyond one reject in this many times n values.
EXTRAPOLATED = 1000
MOST = 2**53  # runs: larger whole numbers are not exact as doubles


@dataclass(frozen=True)
class Share:
    """A counted share of rejects."""

    count: int  # rejects
    n: int  # values
    ppm: float
    interval: Interval  # two-sided Clopper-Pearson [ppm]
    upper: float  # one-sided Clopper-Pearson bound [ppm]; without a reject ``1e6 (1 - (1 - confidence)^(1/n))``
    worth: float  # effective number of independent values, used for interval and bound; n without production lots


@dataclass(frozen=True)
class Nonconforming:
    """Counted shares of one response."""

    below: Share | None  # None without a lower limit
    above: Share | None  # None without an upper limit
    total: Share  # both sides
    with_failures: Share  # over all runs, with failed runs counted as rejects
    # Share of the side with more rejects, over all runs, with every failed run counted as a reject of that side.
    worse_with_failures: Share


def nonconforming(
    x: Array,
    lsl: float | None,
    usl: float | None,
    confidence: float,
    failed: int = 0,
    lots: NDArray[np.generic] | None = None,
) -> Nonconforming | None:
    """Return the counted shares out of limits; None without limits, or without values and failed runs."""
    n = int(x.size)
    if n == 0 or (lsl is None and usl is None):
        return None
    is_below = None if lsl is None else x < lsl
    is_above = None if usl is None else x > usl
    sides = [side for side in (is_below, is_above) if side is not None]
    is_out = sides[0] if len(sides) == 1 else sides[0] | sides[1]
    described = None if lots is None or independent(lots) else describe_lots(x, lots)

    def share(is_counted: NDArray[np.bool_] | None, more: int = 0) -> Share | None:
        if is_counted is None:
            return None
        effect = 1.0 if described is None or lots is None else design_effect(is_counted, lots, described, confidence)
        return counted(int(np.count_nonzero(is_counted)) + more, n + more, confidence, effect)

    worse = max(sides, key=np.count_nonzero)
    total, with_failures, worse_with_failures = share(is_out), share(is_out, failed), share(worse, failed)
    assert total is not None
    assert with_failures is not None
    assert worse_with_failures is not None
    return Nonconforming(share(is_below), share(is_above), total, with_failures, worse_with_failures)


def counted(count: int, n: int, confidence: float, effect: float = 1.0) -> Share:
    """Return the share of `count` rejects among `n` values; `effect` values count as one independent value."""
    count_worth, worth = count / effect, n / effect
    low, high = share_interval(count_worth, worth, confidence)
    upper = PPM * share_upper_bound(count_worth, worth, confidence)
    return Share(count, n, PPM * count / n, (PPM * low, PPM * high), upper, worth)


def weighted_share_interval(weights: Array, n: int, confidence: float, effect: float = 1.0) -> Interval:
    """Return the two-sided interval of a share in which each counted sample has a weight above 0 and of at most 1.

    Fay and Feuer (1997, Statistics in Medicine 16, 791-801): gamma limits of a weighted sum of Poisson counts. With all
    weights 1 it is the exact interval of a Poisson count. `effect` of the `n` samples count as one independent sample.
    """
    total, square = float(np.sum(weights)) / effect, float(np.sum(weights**2)) / effect
    low_p, high_p = 0.5 - confidence / 2, 0.5 + confidence / 2
    low = square / total * float(gammaincinv(total**2 / square, low_p)) if total > 0 else 0.0
    high = (square + 1) / (total + 1) * float(gammaincinv((total + 1) ** 2 / (square + 1), high_p))
    return effect * low / n, min(effect * high / n, 1.0)


def runs_to_claim(ppm: float, confidence: float, rejects: int = 0) -> int:
    """Return the fewest runs that, with so many rejects, prove at most `ppm`: 46,807 for 64 ppm at 95 %."""
    ppm, confidence = real_number("ppm", ppm), real_number("confidence", confidence)
    if not 0 < ppm < PPM:
        raise ReportError(
            f"ppm = {ppm:.15g}: a claim must lie between 0 and 1e6 ppm; no finite number of runs proves 0 ppm"
        )
    if not 0 < confidence < 1:
        raise ReportError(f"confidence = {confidence}: must lie between 0 and 1; 0.95 is usual")
    if not isinstance(rejects, Integral) or not 0 <= rejects < MOST:
        raise ReportError(f"rejects = {rejects}: must be a whole number from 0 to {MOST - 1}")
    if rejects == 0:
        return math.ceil(math.log(1 - confidence) / math.log1p(-ppm / PPM))
    runs = range(int(rejects) + 1, MOST)
    enough = bisect_left(runs, True, key=lambda n: PPM * share_upper_bound(rejects, n, confidence) <= ppm)
    if enough == len(runs):
        raise ReportError(f"ppm = {ppm:.15g} with {rejects} rejects: no number of runs below {MOST} proves it")
    return runs[enough]


def expected_normal(mean: float, std: float, lsl: float | None, usl: float | None) -> dict[str, float]:
    """Return the ppm of a normal distribution "below", "above" and "total", for the sides that have a limit."""
    numbers = {}
    if lsl is not None:
        numbers["below"] = PPM * float(ndtr((lsl - mean) / std))
    if usl is not None:
        numbers["above"] = PPM * float(ndtr((mean - usl) / std))
    return numbers | {"total": sum(numbers.values())} if numbers else {}


def least_ppm(n: int) -> float:
    """Return the smallest share [ppm] that a model fitted to n values can show: one reject in 1,000 n values.

    A normal distribution fitted to 500 values may predict 1e-9 ppm, but 500 values are no evidence for that.
    """
    return PPM / (EXTRAPOLATED * max(n, 1))


def largest_z(n: int) -> float:
    """Return the normal quantile of the smallest share that a model fitted to n values can show."""
    return -float(ndtri(least_ppm(n) / PPM))


def ppm_of_z(z: float) -> float:
    """Return the upper tail of the standard normal distribution beyond z, in ppm."""
    return PPM * math.exp(float(log_ndtr(-z)))
