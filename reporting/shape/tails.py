"""Shares far out in a tail, with too few rejects to count: a generalized Pareto tail beyond a threshold."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtri

from reporting.arrays import Array
from reporting.capability.intervals import Interval, share_interval
from reporting.capability.moments import ROUNDING, series
from reporting.capability.shares import PPM
from reporting.shape import pareto

# Fewer excesses do not determine the shape; more are affected by the curvature of a normal tail: with 2,000 of 30,000
# values the interval of a share of 30 ppm missed it every other time, with 250 as often as stated.
FEWEST_EXCESSES, MOST_EXCESSES, LARGEST_SHARE = 50, 250, 0.10
# How many numbers of excesses are tried: the largest, its half, and so on.
_THRESHOLDS = 3
# A model of the tail is not used for shares below this part of one value: its upper end is never lower.
_FARTHEST = 0.01
# With this many rejects or more the count is better than any model.
ENOUGH_REJECTS = 100


@dataclass(frozen=True)
class TailShare:
    """Share of a response beyond one limit, from a model of the tail."""

    side: str  # "below" or "above"
    limit: float  # in the unit of the values
    ppm: float | None  # None if it is refused, or too far beyond the values for a number
    interval: Interval | None  # two-sided [ppm]; without an estimate it is an upper bound
    method: str = "pareto"
    threshold: float | None = None  # beginning of the fitted tail
    excesses: int | None = None  # values beyond it
    shape: float | None = None  # of the Pareto tail; if negative it has an end
    scale: float | None = None
    note: str = ""  # why the estimate is refused, or why there is only a bound; may be empty


def pareto_tails(x: ArrayLike, lsl: float | None, usl: float | None, confidence: float = 0.95) -> tuple[TailShare, ...]:
    """Return the share beyond each limit from a generalized Pareto tail, the lower limit first.

    Tails are fitted beyond several thresholds (250 excesses or a tenth of the values, and halves of that down to 50);
    those that the Cramer-von Mises statistic rejects at 5 % are ignored. The estimate is that of the most excesses. The
    interval covers those of all thresholds: with many excesses a tail is precise but may still be curved, and one
    threshold alone missed the share in up to 26 of 100 samples of 2,000. Each combines the profile likelihood of the
    share beyond the limit with the binomial error of the share beyond the threshold, on a logarithmic scale. The upper
    end is at least the share of a hundredth of one value. An estimate below that is not given: then the upper end is a
    bound, and at least that of an exponential tail, because a tail that seems to end before the limit may not end.

    Values that are not finite are left out. ReportError: `x` is not a series of numbers.
    """
    values = series(x)
    ordered = np.sort(values[np.isfinite(values)])
    tails = []
    if lsl is not None:
        tails.append(_tail("below", -ordered[::-1], -lsl, confidence))
    if usl is not None:
        tails.append(_tail("above", ordered, usl, confidence))
    return tuple(tails)


def abrupt_ends(ordered: Array) -> tuple[bool, bool]:
    """Return whether the lower and the upper tail of ascending values end abruptly, as those of a cut distribution do.

    The tails are the largest of `pareto_tails`; False where the values are too few for one, or repeat. Of 500 values of
    a normal distribution cut at 2 sigma 92 % of the tails are found, of uncut ones 3 % are taken for cut.
    """
    k = min(MOST_EXCESSES, int(LARGEST_SHARE * ordered.size))

    def is_abrupt(ascending: Array) -> bool:
        if _refusal(ascending, 0, k):
            return False
        excesses = ascending[-k:] - ascending[-k - 1]
        return excesses[0] > 0 and _is_abrupt(pareto.maximum_likelihood_fit(excesses))

    return is_abrupt(-ordered[::-1]), is_abrupt(ordered)


def _tail(side: str, ordered: Array, limit: float, confidence: float) -> TailShare:
    """Return the share above `limit` of ascending values; for the lower side both are mirrored."""
    sign = -1.0 if side == "below" else 1.0
    n = int(ordered.size)
    most = min(MOST_EXCESSES, int(LARGEST_SHARE * n))
    rejects = n - int(np.searchsorted(ordered, limit, side="right"))
    refusal = _refusal(ordered, rejects, most)
    if refusal:
        return TailShare(side, sign * limit, None, None, note=refusal)
    fits = [tail for k in _candidates(most, rejects) if (tail := _beyond_threshold(ordered, limit, k))]
    if not fits:
        count = f"{FEWEST_EXCESSES} to {most}" if most > FEWEST_EXCESSES else f"{most}"
        note = f"A Pareto distribution fits none of the tails of {count} values."
        return TailShare(side, sign * limit, None, None, note=note)
    threshold, excesses, fit = fits[0]
    estimates = [_beyond(y, limit - at, beyond, n, confidence) for at, y, beyond in fits]
    ppm, least = estimates[0][0], PPM * _FARTHEST / n
    low, high = min(ends[0] for _, ends in estimates), max(ends[1] for _, ends in estimates)
    note = ""
    if ppm < least:
        low, high = 0.0, max(high, *(_exponential_bound(y, limit - at, n, confidence) for at, y, _ in fits))
        why = f"The limit is too far beyond {n} values for a number" if ppm else "The fitted tail ends before the limit"
        note = f"{why}, so there is only an upper bound."
    return TailShare(
        side=side,
        limit=sign * limit,
        ppm=ppm if ppm >= least else None,
        interval=(low, max(high, least)),
        threshold=sign * threshold,
        excesses=excesses.size,
        shape=fit.shape,
        scale=fit.scale,
        note=note,
    )


def _beyond_threshold(ordered: Array, limit: float, k: int) -> tuple[float, Array, pareto.ParetoFit] | None:
    """Return threshold, excesses and fit of the tail of `k` values; None if no Pareto tail fits them."""
    threshold = float(ordered[-k - 1])
    excesses = ordered[-k:] - threshold
    if excesses[0] <= 0 or limit <= threshold:
        return None
    fit = pareto.maximum_likelihood_fit(excesses)
    fits = pareto.cramer_von_mises(excesses, fit) <= pareto.critical_cramer_von_mises(fit.shape)
    return (threshold, excesses, fit) if fits and not _is_abrupt(fit) else None


def _is_abrupt(fit: pareto.ParetoFit) -> bool:
    """Return whether a tail ends abruptly: a shape at the lower bound says that the likelihood is not regular."""
    return fit.shape <= pareto.SHAPES[0]


def _refusal(ordered: Array, rejects: int, most: int) -> str:
    """Return why no tail can be fitted; empty if one can be."""
    n = ordered.size
    if most < FEWEST_EXCESSES:
        return f"{n} values are too few for a tail: {math.ceil(FEWEST_EXCESSES / LARGEST_SHARE)} are needed."
    if rejects >= min(ENOUGH_REJECTS, most):
        return f"{rejects} values are beyond the limit, so the counted share is better than any model of the tail."
    top = ordered[n - most :]
    if top[-1] - top[0] <= ROUNDING * float(np.max(np.abs(top))):
        return "The values in the tail are all equal, so no tail is fitted."
    if np.unique(top).size < 0.9 * top.size:
        return "Values in the tail repeat, because they are rounded or bounded, so no smooth tail fits them."
    return ""


def _candidates(most: int, rejects: int) -> list[int]:
    """Return the numbers of excesses to try, the largest first; each tail begins before the limit."""
    fewest = max(FEWEST_EXCESSES, rejects + 1)
    halves = [most // 2**i for i in range(_THRESHOLDS)]
    return sorted({max(k, min(fewest, most)) for k in halves}, reverse=True)


def _beyond(excesses: Array, y: float, fit: pareto.ParetoFit, n: int, confidence: float) -> tuple[float, Interval]:
    """Return the ppm beyond a limit at the distance `y` from the threshold, and its interval."""
    over = excesses.size / n
    share = fit.survival(y)
    low, high = pareto.survival_interval(excesses, y, fit, confidence)
    over_low, over_high = share_interval(excesses.size, n, confidence)
    if share == 0:
        return 0.0, (0.0, PPM * min(over_high * high, 1.0))
    lowest = 0.0
    if low > 0:
        lowest = over * share * math.exp(-math.hypot(math.log(share / low), math.log(over / over_low)))
    highest = over * share * math.exp(math.hypot(math.log(high / share), math.log(over_high / over)))
    return PPM * over * share, (PPM * lowest, PPM * min(highest, 1.0))


def _exponential_bound(excesses: Array, y: float, n: int, confidence: float) -> float:
    """Return the upper end [ppm] of the share of an exponential tail beyond a distance `y` from the threshold."""
    over, scale = excesses.size / n, y / float(np.mean(excesses))
    _, highest = share_interval(excesses.size, n, confidence)
    of_mean = float(ndtri(0.5 + confidence / 2)) * scale / math.sqrt(excesses.size)
    return PPM * min(over * math.exp(-scale + math.hypot(of_mean, math.log(highest / over))), 1.0)
