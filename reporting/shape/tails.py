"""Shares far out in a tail, with their own intervals, where counting sees too few rejects.

Two ways, and each says when it is not valid: a generalized Pareto tail beyond a threshold (`pareto_tail`), and samples
drawn from a distribution that visits the tail more often, weighted back (`tail_from_weights`).
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from reporting.arrays import Array
from reporting.capability.intervals import Interval, share_interval
from reporting.capability.moments import ROUNDING, series
from reporting.capability.shares import PPM
from reporting.errors import ReportError
from reporting.shape import pareto

# Excesses over the threshold: fewer say nothing about the shape, and more bend a normal tail visibly: with 2,000 of
# 30,000 the interval of a share of 30 ppm missed it every other time, with 250 as often as it says.
FEWEST_EXCESSES, MOST_EXCESSES, LARGEST_SHARE = 50, 250, 0.10
_THRESHOLDS = 12
# Counting is better than any model from so many rejects on.
ENOUGH_REJECTS = 100
# A weighted sample that is worth fewer values, or that one value decides, is refused.
FEWEST_EFFECTIVE, LARGEST_WEIGHT = 100.0, 0.05


@dataclass(frozen=True)
class TailShare:
    """Share of a response beyond one limit.

    Attributes
    ----------
    side : str
        "below" or "above".
    limit : float
        In the unit of the values.
    ppm : float or None
        Estimate; None where refused.
    interval : (float, float) or None
        Two-sided [ppm].
    method : str
        "pareto", "weights".
    threshold, excesses : float or None, int or None
        Where the fitted tail begins, and the values beyond it.
    shape, scale : float or None
        Of the Pareto tail; a negative shape ends.
    effective : float or None
        Number of unweighted values the weighted ones are worth (Kish).
    note : str
        Why it is refused, or what to mind; empty if nothing.
    """

    side: str
    limit: float
    ppm: float | None
    interval: Interval | None
    method: str
    threshold: float | None = None
    excesses: int | None = None
    shape: float | None = None
    scale: float | None = None
    effective: float | None = None
    note: str = ""


def pareto_tails(x: ArrayLike, lsl: float | None, usl: float | None, confidence: float = 0.95) -> tuple[TailShare, ...]:
    """Return the share beyond each limit from a generalized Pareto tail.

    The threshold is the one with the most excesses (250 or a tenth of the values at most, 50 at least) whose
    Cramer-von Mises statistic does not reject the tail at 5 %. The interval joins the profile likelihood of the
    share beyond the limit with the binomial error of the share beyond the threshold, on a logarithmic scale.

    Parameters
    ----------
    x : array_like, shape (n,)
        Values; those that are not finite are left out.
    lsl, usl : float or None
        Limits, in the unit of the values.
    confidence : float
        Two-sided.

    Raises
    ------
    ReportError
        `x` is no series of numbers.
    """
    values = series(x)
    ordered = np.sort(values[np.isfinite(values)])
    found = []
    if lsl is not None:
        found.append(_pareto_side("below", -ordered[::-1], -lsl, confidence))
    if usl is not None:
        found.append(_pareto_side("above", ordered, usl, confidence))
    return tuple(found)


def tail_from_weights(
    x: ArrayLike, weights: ArrayLike, lsl: float | None, usl: float | None, confidence: float = 0.95
) -> tuple[TailShare, ...]:
    """Return the share beyond each limit of samples that were drawn from another distribution.

    The estimate is the share of the weights. Its interval is Clopper and Pearson's of a binomial sample with the same
    variance (Korn, Graubard 1998), so it stays right where few or no samples are beyond the limit.

    Parameters
    ----------
    x : array_like, shape (n,)
        Values; those that are not finite are left out with their weights.
    weights : array_like, shape (n,)
        Likelihood ratio of the wanted distribution of the inputs to the one they were drawn from; any scale.
    lsl, usl : float or None
        Limits, in the unit of the values.
    confidence : float
        Two-sided.

    Raises
    ------
    ReportError
        Values or weights are no series of numbers, or not as many as each other; a weight is negative or not finite.
    """
    values, ratio = series(x), series(weights)
    if values.shape != ratio.shape:
        raise ReportError(f"{ratio.size} weights for {values.size} values: one weight for each value is needed")
    if not np.all(np.isfinite(ratio)) or np.any(ratio < 0):
        raise ReportError("weights must be finite and not negative: they are likelihood ratios")
    kept = np.isfinite(values)
    values, ratio = values[kept], ratio[kept]
    found = []
    if lsl is not None:
        found.append(_weighted_side("below", lsl, values < lsl, ratio, confidence))
    if usl is not None:
        found.append(_weighted_side("above", usl, values > usl, ratio, confidence))
    return tuple(found)


def _weighted_side(side: str, limit: float, beyond: NDArray[np.bool_], ratio: Array, confidence: float) -> TailShare:
    """Return the weighted share beyond one limit."""
    largest = float(np.max(ratio, initial=0.0))
    if largest == 0.0:
        return TailShare(side, limit, None, None, "weights", note="No sample has a weight: nothing can be said.")
    w = ratio / float(np.sum(ratio / largest)) / largest
    effective = 1 / float(w @ w)
    if effective < FEWEST_EFFECTIVE or float(np.max(w)) > LARGEST_WEIGHT:
        note = (
            f"{w.size} weighted samples are worth {effective:.0f} (at least {FEWEST_EFFECTIVE:.0f} are needed), the "
            f"heaviest carries {100 * float(np.max(w)):.2g} % of the weight ({100 * LARGEST_WEIGHT:.0f} % at most): "
            "draw new samples closer to the wanted distribution."
        )
        return TailShare(side, limit, None, None, "weights", effective=effective, note=note)
    share = float(np.sum(w[beyond]))
    variance = float(np.sum((w * (beyond - share)) ** 2))
    worth = share * (1 - share) / variance if variance > 0 and 0 < share < 1 else effective
    low, high = share_interval(share * worth, worth, confidence)
    note = "" if share > 0 else "No sample beyond the limit: the upper end is all that is known."
    interval = (PPM * low, PPM * high)
    return TailShare(side, limit, PPM * share, interval, "weights", effective=effective, note=note)


def _pareto_side(side: str, ordered: Array, limit: float, confidence: float) -> TailShare:
    """Return the Pareto share above `limit` of ascending values; of a lower side both come mirrored."""
    shown = -limit if side == "below" else limit
    n = int(ordered.size)
    most = min(MOST_EXCESSES, int(LARGEST_SHARE * n))
    rejects = n - int(np.searchsorted(ordered, limit, side="right"))
    refusal = _refusal(ordered, rejects, most)
    if refusal:
        return TailShare(side, shown, None, None, "pareto", note=refusal)
    for k in _candidates(most, max(FEWEST_EXCESSES, rejects + 1)):
        threshold = float(ordered[n - k - 1])
        excesses = ordered[n - k :] - threshold
        if excesses[0] <= 0 or limit <= threshold:
            continue
        tail = pareto.fit(excesses)
        if tail.shape > pareto.SHAPES[0] and pareto.crookedness(excesses, tail) <= pareto.critical_crookedness(
            tail.shape
        ):
            ppm, interval, note = _beyond(excesses, limit - threshold, tail, n, confidence)
            start = -threshold if side == "below" else threshold
            return TailShare(side, shown, ppm, interval, "pareto", start, k, tail.shape, tail.scale, note=note)
    note = f"No threshold with {FEWEST_EXCESSES} to {most} values beyond it leaves a Pareto tail that ends gently."
    return TailShare(side, shown, None, None, "pareto", note=note)


def _refusal(ordered: Array, rejects: int, most: int) -> str:
    """Return why no tail can be fitted, empty if one can be tried."""
    n = ordered.size
    if most < FEWEST_EXCESSES:
        return f"{n} values are too few for a tail: {math.ceil(FEWEST_EXCESSES / LARGEST_SHARE)} are needed."
    if rejects >= min(ENOUGH_REJECTS, most):
        return f"{rejects} values are beyond the limit: the counted share is better than any model of the tail."
    top = ordered[n - most :]
    if top[-1] - top[0] <= ROUNDING * float(np.max(np.abs(top))):
        return "The values in the tail are all equal: no shape."
    if np.unique(top).size < 0.9 * top.size:
        return "Values in the tail repeat: they are rounded or bounded, and no smooth tail fits them."
    return ""


def _candidates(most: int, fewest: int) -> list[int]:
    """Return the numbers of excesses to try, most first."""
    if most <= fewest:
        return [most]
    return sorted({int(k) for k in np.geomspace(most, fewest, _THRESHOLDS)}, reverse=True)


def _beyond(
    excesses: Array, y: float, tail: pareto.ParetoFit, n: int, confidence: float
) -> tuple[float, Interval, str]:
    """Return the ppm beyond a limit y above the threshold, its interval, and what to mind."""
    over = excesses.size / n
    share = pareto.survival(y, tail)
    low, high = pareto.survival_interval(excesses, y, tail, confidence)
    over_low, over_high = share_interval(excesses.size, n, confidence)
    lowest = highest = 0.0
    if share > 0 and low > 0:
        lowest = over * share * math.exp(-math.hypot(math.log(share / low), math.log(over / over_low)))
    if share > 0:
        highest = over * share * math.exp(math.hypot(math.log(high / share), math.log(over_high / over)))
    else:
        highest = over_high * high
    note = (
        "" if share > 0 else "The fitted tail ends before the limit: only the upper end of the interval says anything."
    )
    return PPM * over * share, (PPM * lowest, PPM * min(highest, 1.0)), note
