"""What rejects have in common, and which samples are the worst.

For every variable: how far its mean among the rejects lies from its mean among the others, with Welch's interval, and
the largest distance of its two distribution functions (Kolmogorov, Smirnov). Where there are too few rejects to ask,
the samples with the least margin stand for them, and `group` says so.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import kolmogorov, stdtrit

from reporting.arrays import Array, random_rows
from reporting.capability.intervals import Interval

FEWEST = 20  # rejects from which their means say something
TAIL_SHARE = 0.01
LISTED = 5
REJECTS, TAIL = "rejects", "least margin"


@dataclass(frozen=True)
class RejectDifference:
    """How one variable differs between the rejects and the others.

    Attributes
    ----------
    variable : str
    mean, mean_others : float
        Among rejects and others, in the variable's unit.
    shift : float
        Their difference in standard deviations of the variable.
    shift_interval : (float, float)
        Welch's interval of it.
    distance : float
        Largest distance of the distribution functions, 0 to 1; it also sees a spread that differs.
    p_value : float
        Of a distance this large if there were no difference (asymptotic).
    """

    variable: str
    mean: float
    mean_others: float
    shift: float
    shift_interval: Interval
    distance: float
    p_value: float


@dataclass(frozen=True)
class RejectCauses:
    """What the rejects of a response have in common.

    Attributes
    ----------
    group : str
        "rejects", or "least margin": the 1 % (at least 20) nearest to a limit, where rejects are fewer than 20.
    count, others : int
        Samples of the group, and the rest.
    rejects : int
        Values out of limits.
    differences : tuple of RejectDifference
        One a variable, the largest distance first.
    """

    group: str
    count: int
    others: int
    rejects: int
    differences: tuple[RejectDifference, ...]


@dataclass(frozen=True)
class WorstSample:
    """A sample nearest to, or farthest beyond, a limit.

    Attributes
    ----------
    side : str
        "lower" or "upper" limit.
    sample : int
        Its number.
    value, margin : float
        Of the response, and to the limit: negative beyond it; in the response's unit.
    inputs : dict of str to float
        The variables.
    """

    side: str
    sample: int
    value: float
    margin: float
    inputs: dict[str, float]


def reject_causes(
    y: Array, inputs: dict[str, Array], lsl: float | None, usl: float | None, confidence: float
) -> RejectCauses | None:
    """Return what rejects have in common; None without limits, or where group or rest are fewer than 20.

    Parameters
    ----------
    y : array, shape (n,)
        The response, finite.
    inputs : dict of str to array, each of shape (n,)
        The variables, finite, none constant.
    lsl, usl : float or None
        Limits.
    confidence : float
        Of the intervals.
    """
    margins = [m for m in (None if lsl is None else y - lsl, None if usl is None else usl - y) if m is not None]
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
    """Return the five samples of least margin to each limit, the worst first, lower limit first.

    Parameters
    ----------
    sample : array of int64, shape (n,)
        Numbers of the samples.
    y : array, shape (n,)
        The response, finite.
    inputs : dict of str to array, each of shape (n,)
        The variables.
    lsl, usl : float or None
        Limits.
    """
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
    """Compare one variable between two groups, of at least two values each."""
    whole = np.concatenate([a, b])
    std = float(np.std(whole, ddof=1))
    part_a, part_b = float(np.var(a, ddof=1)) / a.size, float(np.var(b, ddof=1)) / b.size
    shift = float(a.mean() - b.mean()) / std
    both = part_a + part_b
    freedom = both**2 / (part_a**2 / (a.size - 1) + part_b**2 / (b.size - 1)) if both > 0 else float(whole.size)
    half = float(stdtrit(freedom, 0.5 + confidence / 2)) * math.sqrt(both) / std
    distance = _distance(a, b)
    p_value = float(kolmogorov(distance * math.sqrt(a.size * b.size / whole.size)))
    return RejectDifference(
        name, float(a.mean()), float(b.mean()), shift, (shift - half, shift + half), distance, p_value
    )


def _distance(a: Array, b: Array) -> float:
    """Return the largest distance of two empirical distribution functions."""
    a, b = np.sort(a), np.sort(b)
    at = np.concatenate([a, b])
    below_a, below_b = np.searchsorted(a, at, "right") / a.size, np.searchsorted(b, at, "right") / b.size
    return float(np.max(np.abs(below_a - below_b)))
