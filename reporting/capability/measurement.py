"""What the measuring system adds to measured values, and what it leaves undecided near the limits.

Sigma of the process behind the gauge: ``sqrt(s^2 - g^2)``, with g the sigma of repeatability and reproducibility,
because errors of measurement add to the parts' variance. Its index and interval (generalized, as `reporting.gauge`)
are for normal, independent values; where these are not, or where the gauge may be all that varies, the interval is
withheld.

Conformity by ISO 14253-1: within the limits less the expanded uncertainty U a part is proved to conform, beyond the
limits plus U proved not to; between them nothing is proved.
"""

import math
from dataclasses import dataclass

import numpy as np

from reporting.arrays import Array
from reporting.capability.indices import distance_to_limit
from reporting.capability.intervals import Interval

_DRAWS = 20_000


@dataclass(frozen=True)
class BehindGauge:
    """The process without the errors of its gauge; None where it is not defined."""

    gauge: float  # sigma of the gauge, in the unit of the values
    share: float  # of the gauge in the variance of the values
    of_tolerance: float | None  # six sigmas of the gauge over the tolerance; None with one limit
    std: float | None  # sigma of the process; None if that of the gauge is no smaller than that of the values
    cpk: float | None
    cpk_interval: Interval | None
    note: str  # why there is no interval; may be empty


@dataclass(frozen=True)
class Conformity:
    """What measurements prove of the parts, with an expanded uncertainty."""

    uncertainty: float  # U, in the unit of the values
    low: float | None  # zone in which a value proves conformity; None without that limit
    high: float | None
    conforming: int  # parts proved to conform
    nonconforming: int  # parts proved not to
    undecided: int


def behind_gauge(
    x: Array,
    lsl: float | None,
    usl: float | None,
    gauge: float,
    freedom: float | None,
    confidence: float,
    doubt: str,
) -> BehindGauge | None:
    """Return the process behind a gauge of known sigma, or of one known with so many degrees of freedom.

    No interval is given if `doubt` says why it would not hold. None below 3 values, or without spread.
    """
    n = x.size
    if n < 3 or not (std := float(x.std(ddof=1))) > 0:
        return None
    mean, ratio = float(x.mean()), (gauge / std) ** 2
    of_tolerance = None if lsl is None or usl is None else 6 * gauge / (usl - lsl)
    if ratio >= 1:
        note = "The gauge varies as much as the values: they say nothing of the process."
        return BehindGauge(gauge, ratio, of_tolerance, None, None, None, note)
    process = std * math.sqrt(1 - ratio)
    limited = lsl is not None or usl is not None
    cpk = distance_to_limit(mean, lsl, usl) / (3 * process) if limited else None
    if cpk is None or doubt:
        return BehindGauge(gauge, ratio, of_tolerance, process, cpk, None, doubt if limited else "")
    rng = np.random.Generator(np.random.PCG64(n))
    observed = std**2 * (n - 1) / rng.chisquare(n - 1, _DRAWS)
    means = mean + rng.normal(size=_DRAWS) * np.sqrt(observed / n)
    of_gauge = gauge**2 * (1.0 if freedom is None else freedom / rng.chisquare(freedom, _DRAWS))
    left = observed - of_gauge
    tail = (1 - confidence) / 2
    if np.mean(left <= 0) >= tail:
        note = (
            "The gauge may be all that varies: the index of the process has no upper end; measure better or more parts."
        )
        return BehindGauge(gauge, ratio, of_tolerance, process, cpk, None, note)
    near = np.minimum(math.inf if lsl is None else means - lsl, math.inf if usl is None else usl - means)
    with np.errstate(divide="ignore"):
        draws = near / (3 * np.sqrt(np.maximum(left, 0.0)))
    low, high = np.quantile(draws, (tail, 1 - tail))
    return BehindGauge(gauge, ratio, of_tolerance, process, cpk, (float(low), float(high)), "")


def conformity(x: Array, lsl: float | None, usl: float | None, uncertainty: float) -> Conformity | None:
    """Return what values prove of their parts; None without a limit."""
    if lsl is None and usl is None:
        return None
    low, high = (-math.inf if lsl is None else lsl), (math.inf if usl is None else usl)
    conforming = int(np.count_nonzero((x >= low + uncertainty) & (x <= high - uncertainty)))
    beyond = int(np.count_nonzero((x < low - uncertainty) | (x > high + uncertainty)))
    return Conformity(
        uncertainty,
        None if lsl is None else lsl + uncertainty,
        None if usl is None else usl - uncertainty,
        conforming,
        beyond,
        x.size - conforming - beyond,
    )
