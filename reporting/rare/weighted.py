"""A share of rejects from weighted runs, and its reliability.

The estimate is the sum of the rejects' weights divided by the number of all runs. It is unbiased, because every weight
is the known ratio of the density in production to that in the campaign. Its interval:

- the gamma limits of Fay and Feuer (1997) for the weights of all rejects, aimed at or found by chance;
- where a few rejects were found by chance, at which no component aims, their few weights say little about their sum.
  Their number says more. Beyond a flat limit b standard scores from the middle lies the share Phi(-b) of production,
  and the share Phi(-b / s) of a component that spreads all scores s times as far. The Phi(-b) at which this small a
  number is just plausible is added to the upper end;
- the upper end never exceeds what the plain runs allow by their count alone (Clopper and Pearson). That bound assumes
  nothing. It is the only one if there are fewer than five rejects, or if their weights do not determine their sum: few
  effective ones, one that dominates, or a heavy tail.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv, ndtr

from reporting.arrays import Array
from reporting.capability.intervals import Interval, share_upper_bound
from reporting.capability.shares import PPM, weighted_share_interval
from reporting.shape.pareto import posterior_mean_fit

FEWEST = 20  # effective rejects: with fewer the coverage of the gamma limits is too low
LEAST = 5  # rejects: with fewer there is no estimate, only the bound by the plain runs
CAP = 0.995  # confidence of the plain runs' bound as a cap: so high that it is hardly ever wrong where it cuts
LARGEST_PART = 0.10  # largest part of one weight in the sum: up to it the limits were measured to hold
HEAVIEST = 0.7  # Pareto shape of the weights above which their mean is unreliable (Vehtari et al. 2024)
FARTHEST = 37.0  # standard scores: shares beyond are 0 in double precision
_TAIL = 5  # fewest weights for the fit of a tail


@dataclass(frozen=True)
class Draws:
    """How the runs of an importance campaign were drawn."""

    weights: Array  # of all finished runs, ok or not, shape (n,)
    by_chance: NDArray[np.bool_]  # drawn by a component without shift, in a region where no other component aims
    unshifted: NDArray[np.bool_]  # drawn by a component without shift
    # For each component without shift, including the distributions themselves: the share of all runs that it draws
    # where no other component aims, and its scale.
    spreads: tuple[tuple[float, float], ...]
    confidence: float  # of the two-sided intervals
    plain: NDArray[np.bool_]  # drawn from the distributions themselves


@dataclass(frozen=True)
class RareShare:
    """A weighted share of production."""

    ppm: float  # unbiased estimate
    interval: Interval  # two-sided [ppm]; from 0 if the weights do not support a lower end
    standard_error: float | None  # relative to the estimate; None without a reject
    rejects: int  # runs
    effective: float  # rejects of equal weight (Kish)
    largest: float  # share of the largest weight in the sum; 0 without a reject
    tail_shape: float | None  # Pareto shape of the largest weights; None with too few of them
    by_chance: int  # rejects where no component aims, found by a component without shift
    by_chance_ppm: float  # allowance of the upper end of the interval for such regions, behind a flat limit
    plain_runs: float | None  # plain independent runs with the same precision; None without a reject
    doubt: str  # why the weights do not support a lower end, and a remedy; empty if they do


def rare_share(rejects: NDArray[np.bool_], draws: Draws) -> RareShare:
    """Return the weighted share of the runs marked in ``rejects``, shape (n,), n above 0."""
    n, w = rejects.size, draws.weights[rejects]
    share, square = float(np.sum(w)) / n, float(np.sum(w * w)) / n
    variance = max(square - share * share, 0.0) / n
    by_chance = rejects & draws.by_chance
    chance, sought = draws.weights[by_chance], draws.weights[rejects & ~by_chance]
    few_by_chance = bool(chance.size) and bool(_doubt(chance))
    # A few found by chance, with an allowance of their own, do not spoil what the sought ones tell.
    doubt = _doubt(w) and _doubt(sought if sought.size and few_by_chance else w)
    counted, plain = int(np.count_nonzero(rejects & draws.plain)), int(np.count_nonzero(draws.plain))
    allowance = flat_bound(chance.size if few_by_chance else 0, n, draws)
    low, high = 0.0, _most(counted, plain, 0.5 + draws.confidence / 2)
    if w.size and not doubt:
        low, high = _gamma_limits(w, n, draws.confidence)
        high = min(high + allowance, _most(counted, plain, CAP))
    return RareShare(
        ppm=PPM * share,
        interval=(PPM * low, PPM * max(high, share)),
        standard_error=float(np.sqrt(variance)) / share if share > 0 else None,
        rejects=w.size,
        effective=_kish(w),
        largest=float(w.max() / w.sum()) if w.size else 0.0,
        tail_shape=tail_shape(w),
        by_chance=chance.size,
        by_chance_ppm=PPM * allowance,
        plain_runs=share * (1 - share) / variance if variance > 0 else None,
        doubt=doubt,
    )


def _most(count: int, plain: int, confidence: float) -> float:
    """Return the one-sided upper bound of a share by the plain runs alone; 1 without plain runs."""
    return share_upper_bound(count, plain, confidence) if plain else 1.0


def flat_bound(count: int, n: int, draws: Draws) -> float:
    """Return the largest share beyond a flat limit that is plausible with `count` rejects among `n` runs.

    Only rejects that components without shift have drawn are counted.
    """
    most = float(gammaincinv(count + 1, 0.5 + draws.confidence / 2))

    def excess(b: float) -> float:
        return n * sum(share * float(ndtr(-b / scale)) for share, scale in draws.spreads) - most

    if excess(0.0) <= 0.0:
        return 1.0
    from scipy.optimize import brentq  # takes 0.4 s, which `import reporting` avoids

    return float(ndtr(-brentq(excess, 0.0, 8 * FARTHEST)))


def tail_shape(weights: Array) -> float | None:
    """Return the Pareto shape of the largest weights; None if they are too few or all equal."""
    # The number of tail weights of Pareto-smoothed importance sampling (Vehtari et al. 2024).
    tail = int(min(0.2 * weights.size, 3.0 * np.sqrt(weights.size)))
    if tail < _TAIL:
        return None
    ordered = np.sort(weights)
    excesses = ordered[-tail:] - ordered[-tail - 1]
    if not excesses[0] > 0.0:
        return None
    return posterior_mean_fit(excesses)[0]


def _kish(w: Array) -> float:
    """Return the effective number of equal weights."""
    return float(np.sum(w) ** 2 / np.sum(w * w)) if w.size else 0.0


def _gamma_limits(w: Array, n: int, confidence: float) -> Interval:
    """Return the interval of a share of weighted runs."""
    if not w.size:
        return 0.0, 0.0
    # `weighted_share_interval` takes weights of at most 1.
    low, high = weighted_share_interval(w / w.max(), n, confidence)
    return low * float(w.max()), high * float(w.max())


def _doubt(w: Array) -> str:
    """Return why the weights of rejects do not determine their sum; empty if they do, or without rejects."""
    if not w.size:
        return ""
    if w.size < LEAST:
        return f"{w.size} rejects were found, and {LEAST} are the least for an estimate"
    effective, largest, shape = _kish(w), float(w.max() / w.sum()), tail_shape(w)
    if effective < FEWEST:
        return f"its {w.size} rejects are worth {effective:.2g} of equal weight, and {FEWEST} are needed"
    if largest > LARGEST_PART:
        return f"one reject has {100 * largest:.0f} % of the weight of all"
    if shape is not None and shape > HEAVIEST:
        return f"the weights have a heavy tail (Pareto shape {shape:.2f}, at most {HEAVIEST:g} is sound)"
    return ""
