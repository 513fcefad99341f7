"""Common properties of rejects, and the worst samples.

For each variable: the difference of its means among rejects and other samples with Welch's (1947) interval, and the
distance of its two distribution functions (Kolmogorov, Smirnov). With too few rejects the samples nearest to a limit
are used instead, and `RejectCauses.group` says so.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import kolmogorov

from reporting.arrays import Array, random_rows
from reporting.capability.intervals import Interval, welch

FEWEST = 20  # fewest samples in each of the compared groups
TAIL_SHARE = 0.01
LISTED = 5
REJECTS, TAIL = "rejects", "least margin"


@dataclass(frozen=True)
class RejectDifference:
    """Difference of one variable between the rejects and the other samples."""

    variable: str
    mean: float  # among rejects, in the unit of the variable
    mean_others: float  # among the other samples
    shift: float  # difference of the means in standard deviations of the variable
    shift_interval: Interval  # Welch's
    distance: float  # Kolmogorov's, of the distribution functions, 0 to 1; it also detects a difference in spread
    p_value: float  # of a distance at least as large if there is no difference (asymptotic)


@dataclass(frozen=True)
class RejectCauses:
    """Common properties of the rejects of a response."""

    group: str  # "rejects"; with fewer than 20, "least margin": the 1 % (at least 20) nearest to a limit
    count: int  # samples of the group
    others: int  # all other samples
    rejects: int  # values out of limits
    differences: tuple[RejectDifference, ...]  # one per variable, the largest distance first


@dataclass(frozen=True)
class WorstSample:
    """A sample near a limit or beyond it."""

    side: str  # "lower" or "upper" limit
    sample: int  # its number
    value: float  # of the response, in its unit
    margin: float  # to the limit, negative beyond it
    inputs: dict[str, float]  # values of the variables


def reject_causes(
    y: Array, inputs: dict[str, Array], lsl: float | None, usl: float | None, confidence: float
) -> RejectCauses | None:
    """Return the common properties of rejects; None without limits, or with fewer than 20 samples in a group.

    Response and variables, shape (n,), are finite; no variable is constant.
    """
    margins = [*([] if lsl is None else [y - lsl]), *([] if usl is None else [usl - y])]
    if not margins:
        return None
    margin = np.min(margins, axis=0)
    out = margin < 0
    rejects, group = int(np.count_nonzero(out)), REJECTS
    if rejects < FEWEST:
        count = max(math.ceil(TAIL_SHARE * y.size), FEWEST)
        if y.size < 2 * count:
            return None
        group, out = TAIL, np.zeros(y.size, np.bool_)
        out[np.argpartition(margin, count)[:count]] = True
    inside, outside = np.flatnonzero(~out), np.flatnonzero(out)
    if inside.size < FEWEST:
        return None
    a, b = outside[random_rows(outside.size)], inside[random_rows(inside.size)]
    differences = (_difference(name, column[a], column[b], confidence) for name, column in inputs.items())
    ranked = sorted(differences, key=lambda d: -d.distance)
    return RejectCauses(group, outside.size, inside.size, rejects, tuple(ranked))


def worst_samples(
    sample: NDArray[np.int64], y: Array, inputs: dict[str, Array], lsl: float | None, usl: float | None
) -> tuple[WorstSample, ...]:
    """Return the five samples with the smallest margin to each limit, the lower limit and the worst sample first."""
    worst = []
    for side, margin in (("lower", None if lsl is None else y - lsl), ("upper", None if usl is None else usl - y)):
        if margin is None:
            continue
        few = np.argpartition(margin, LISTED)[:LISTED] if y.size > LISTED else np.arange(y.size)
        for row in few[np.lexsort((sample[few], margin[few]))]:
            values = {name: float(column[row]) for name, column in inputs.items()}
            worst.append(WorstSample(side, int(sample[row]), float(y[row]), float(margin[row]), values))
    return tuple(worst)


def _difference(name: str, a: Array, b: Array, confidence: float) -> RejectDifference:
    """Compare one variable between two groups of at least two values each."""
    whole = np.concatenate([a, b])
    std = float(np.std(whole, ddof=1))
    shift, (low, high), _ = welch(a, b, confidence)
    distance = largest_distance(a, b)
    return RejectDifference(
        variable=name,
        mean=float(a.mean()),
        mean_others=float(b.mean()),
        shift=shift / std,
        shift_interval=(low / std, high / std),
        distance=distance,
        p_value=float(kolmogorov(distance * math.sqrt(a.size * b.size / whole.size))),
    )


def largest_distance(a: Array, b: Array) -> float:
    """Return the largest distance of two empirical distribution functions."""
    a, b = np.sort(a), np.sort(b)
    at = np.concatenate([a, b])
    below_a, below_b = np.searchsorted(a, at, "right") / a.size, np.searchsorted(b, at, "right") / b.size
    return float(np.max(np.abs(below_a - below_b)))
