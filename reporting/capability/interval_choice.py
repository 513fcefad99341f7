"""Choice of the intervals of the indices that are valid for the given values.

There are three methods, tried in this order:

- "production lots": values of a lot share a shift, so the intervals are based on the differences between lots.
- "own moments": skewness or kurtosis differs from that of a normal distribution, or the tails are heavier, even if
  only by chance; so the intervals are based on the third and fourth moments of the values.
- "normal theory": the exact intervals for normal values.

The threshold for the second method is low on purpose: normal theory must not be chosen by mistake where its intervals
are too narrow, and where it is correct the other intervals are valid as well. Measured coverage of the choice at n = 50
with 4,000 repetitions: 92 to 97 % for normal, lognormal(0.5), gamma(16), t5, uniform and bimodal values; normal theory
alone: 70 to 100 %.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from reporting.arrays import Array
from reporting.capability.indices import centring, overall_intervals, point_indices
from reporting.capability.intervals import Interval, cpm_interval, mean_interval, std_interval
from reporting.capability.lots import Lots
from reporting.capability.moments import FEWEST_FOR_SHAPE, LIKELY, normal_moments_p
from reporting.capability.robust_intervals import (
    Precision,
    centred,
    freedom_of_spread,
    joint_interval,
    precision_of_lots,
    precision_of_values,
    robust_intervals,
)
from reporting.format_numbers import part

NORMAL, OWN_MOMENTS, PRODUCTION_LOTS = "normal theory", "own moments", "production lots"
# A p-value below this proves that the values are not normal.
PROVEN = 0.05
# With fewer values, intervals from own moments cover only 87 to 91 % for skewed responses.
_FEW_VALUES = 50
# Below this, a few values dominate sigma, and 95 % intervals of Cpk cover 79 to 90 %: of samples of 500 values, 94 % of
# Student's t with 3 degrees of freedom, all of lognormal(1), 1 % of the normal ones. Of smaller samples so many normal
# ones are below it that it says nothing.
_FEW_FREEDOM, _TELLS_FROM = 25.0, 500
# A part of this many times the width may be missing among n values; what it would do to sigma depends on n alone, so it
# is said of every sample, not of those that happen to have an outlier, which need it least. Below `_SMALL` it is not.
_WIDER, _MISSED, _SMALL = 5.0, 0.05, 0.02


@dataclass(frozen=True)
class Method:
    """The method of the intervals."""

    name: str  # one of the three, empty where intervals are withheld
    reason: str  # a sentence, for the report
    normal: bool  # whether skewness and kurtosis are compatible with a normal distribution


@dataclass(frozen=True)
class Fence:
    """Limits and target of a response, and the confidence of its intervals; None where there is no limit or target."""

    lsl: float | None
    usl: float | None
    target: float | None
    confidence: float


def choose_method(x: Array, kurtosis: float | None, lots: Lots | None) -> Method:
    """Return the method whose intervals are valid for at least two finite values that are not all equal.

    `kurtosis` is their excess kurtosis G2, None below four values; `lots` is None for independent values.
    """
    worth = float(x.size) if lots is None else lots.effective
    deviation = centred(x)[1]
    p = normal_moments_p(deviation, worth) if worth >= FEWEST_FOR_SHAPE else 1.0
    normal = p >= PROVEN
    if lots is not None:
        return Method(PRODUCTION_LOTS if lots.enough else "", _of_lots(lots), normal)
    # A kurtosis above 0 counts even if it may be chance: with heavy tails the intervals of normal theory are too narrow
    # (t5: they cover 76 %), and where normal theory is right the other intervals are valid as well.
    if kurtosis is not None and x.size >= FEWEST_FOR_SHAPE and (p < LIKELY or kurtosis > 0):
        squares = deviation**2
        return Method(OWN_MOMENTS, _of_moments(x.size, p, freedom_of_spread(squares - squares.mean())), normal)
    if x.size < FEWEST_FOR_SHAPE:
        return Method(NORMAL, f"Normal theory: {x.size} values are too few to show another shape.", normal)
    few = f" Fewer than {_FEW_VALUES} values show only a large departure." if x.size < _FEW_VALUES else ""
    agrees = f"Normal theory: skewness and kurtosis agree with a normal distribution (p = {p:.2g})."
    return Method(NORMAL, f"{agrees}{few}{_unseen(x.size)}", normal)


def precision_by(
    method: Method, x: Array, kurtosis: float | None, lots: NDArray[np.generic] | None, confidence: float
) -> Precision | None:
    """Return the intervals of mean and sigma by a method; None for normal theory and where they are withheld."""
    if method.name == PRODUCTION_LOTS and lots is not None:
        return precision_of_lots(x, lots, confidence)
    return precision_of_values(x, kurtosis or 0.0, confidence) if method.name == OWN_MOMENTS else None


def index_intervals(
    method: Method, x: Array, kurtosis: float | None, fence: Fence, lots: NDArray[np.generic] | None
) -> dict[str, Interval | None]:
    """Return the intervals of mean, sigma and indices by the names of their fields; empty where they are withheld.

    `method` and `kurtosis` are those of `choose_method`; `lots`, shape (n,), is None for independent values.
    """
    if method.name == NORMAL:
        return _normal_theory(x, centred(x)[1], fence)
    precision = precision_by(method, x, kurtosis, lots, fence.confidence)
    # Fails half as often: `joint_interval` needs both upper ends to be correct.
    wider = precision_by(method, x, kurtosis, lots, (1 + fence.confidence) / 2)
    if precision is None or wider is None:
        return {}
    return {
        **robust_intervals(precision, fence.lsl, fence.usl, fence.target),
        "cpk_interval_joint": joint_interval(precision, wider, fence.lsl, fence.usl),
    }


def _normal_theory(x: Array, deviation: Array, fence: Fence) -> dict[str, Interval | None]:
    """Return the intervals by normal theory."""
    n, confidence = x.size, fence.confidence
    mean, std = float(np.mean(x)), float(np.std(deviation, ddof=1))
    index = point_indices(mean, std, fence.lsl, fence.usl)
    found = overall_intervals(index, centring(mean, fence.lsl, fence.usl), n, confidence)
    found["mean_interval"] = mean_interval(mean, std, n, confidence)
    found["std_interval"] = std_interval(std, n, confidence)
    if fence.lsl is not None and fence.usl is not None and fence.target is not None:
        offset = mean - fence.target
        around = math.sqrt(float(np.mean(deviation**2)) + offset * offset)
        cpm, scaled = (fence.usl - fence.lsl) / (6 * around), offset / float(np.std(deviation))
        found["cpm_interval"] = cpm_interval(cpm, scaled, n, confidence) if math.isfinite(scaled) else None
    return found


def _of_lots(lots: Lots) -> str:
    """Return why the intervals are based on lots, or why there is none."""
    if not lots.enough:
        unequal = "" if lots.worth > lots.count - 0.5 else f", of unequal size, worth {lots.worth:.1f}"
        return (
            f"{lots.count} production lot{'s' * (lots.count != 1)}{unequal}: intervals need {lots.least}, because "
            "each lot counts as one value for the spread between lots; add more lots."
        )
    text = (
        f"Values of a production lot share a shift: the intervals rest on the differences between {lots.count} lots, "
        f"whose values are worth {lots.effective:.0f} independent ones."
    )
    return f"{text} {lots.blind}".rstrip()


def _of_moments(n: int, p: float, freedom: float) -> str:
    """Return why the intervals are based on the values' own moments, and their limitation."""
    why = (
        f"skewness and kurtosis are not those of a normal distribution (p = {p:.2g})"
        if p < LIKELY
        else "the tails are a little heavier than normal ones, which may be chance"
    )
    few = ""
    if n < _FEW_VALUES:
        few = f" With fewer than {_FEW_VALUES} values the intervals of a skewed response cover less than stated."
    elif n >= _TELLS_FROM and freedom < _FEW_FREEDOM:
        few = " A few extreme values determine sigma: if rarer, larger ones exist, the intervals are too narrow."
    return f"The intervals rest on the values' own third and fourth moments: {why}.{few}{_unseen(n)}"


def _unseen(n: int) -> str:
    """Return what n values need not show, and what it would do to sigma; empty if that is little."""
    share = -math.expm1(math.log(_MISSED) / n)
    growth = math.sqrt(1 + share * (_WIDER**2 - 1)) - 1
    if growth < _SMALL:
        return ""
    return (
        f" {n} values may miss {part(share)} of production that is {_WIDER:g} times as wide, with which sigma would be"
        f" {part(growth)} larger."
    )
