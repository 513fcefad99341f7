"""The section Rare rejects: shares of a few ppm from weighted runs, of every response and of the whole product.

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

The weights are checked against plain Monte Carlo, at a share that both can estimate. Some runs of the campaign are
drawn from the distributions themselves (plain runs). The limit is moved inward until a few percent of the plain runs
lie beyond it; their counted share must agree with the weighted share of all runs. The difference is the mean of I (w -
c / a0) over the runs: I is 1 if a run lies beyond, w its weight, c is 1 for a plain run, a0 is the share of plain runs.
Its expectation is 0 for every limit, and its standard error is known.
"""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv, ndtr

from reporting.arrays import Array
from reporting.capability.intervals import Estimate, Interval, share_upper_bound
from reporting.capability.shares import PPM, weighted_share_interval
from reporting.capability.verdict import WEIGHTED, index_of_share
from reporting.format_numbers import grouped, ppm
from reporting.samples import Samples
from reporting.shape.pareto import posterior_mean_fit
from reporting.spec import ProposalPart, ReportSpec, ResponseSpec

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
        # `weighted_share_interval` takes weights of at most 1
        low, high = (float(w.max()) * end for end in weighted_share_interval(w / w.max(), n, draws.confidence))
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
    """Return the largest plausible share beyond a flat limit, with `count` rejects by unshifted components."""
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
    return float(np.sum(w) ** 2 / np.sum(w * w)) if w.size else 0.0


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


SEEN = 0.02  # share of plain runs beyond the moved limit; at least FEWEST_SEEN runs
FEWEST_SEEN = 20
CHECK_BAR = 4.0  # standard errors that are not exceeded by chance


@dataclass(frozen=True)
class PlainCheck:
    """A share estimated from plain and from weighted runs."""

    response: str
    side: str  # "below" or "above"
    at: float  # the moved limit, in the response's unit
    plain: float  # share beyond it, counted among the plain runs
    weighted: float  # the same, weighted over all runs
    errors: float  # their difference in standard errors


@dataclass(frozen=True)
class RareResponse:
    """Rare rejects of one response."""

    response: str
    below: RareShare | None  # None without a lower limit
    above: RareShare | None  # None without an upper limit
    total: RareShare  # beyond either limit
    index: float | None  # from the share of the worse side, -Phi^-1(share) / 3: 1.33 at 33 ppm; None without a reject
    index_interval: tuple[float, float | None]  # the upper end is None without a bound


@dataclass(frozen=True)
class RareRejects:
    """The rare rejects of an importance-sampling campaign."""

    runs: int  # finished ones
    plain: int  # those drawn from the distributions themselves
    effective: float  # runs of equal weight (Kish)
    mean_weight: float
    mean_weight_errors: float  # deviation of the mean weight from 1 in standard errors
    responses: tuple[RareResponse, ...]  # those with limits
    together: RareShare | None  # beyond any limit of any response; None without limits
    failed: RareShare  # runs that failed or have no value of a response with limits
    with_failures: RareShare | None  # beyond any limit, or failed; None without limits
    # Largest region of rejects that may have been missed behind a flat limit [ppm]; runs would have met a larger one.
    unseen_ppm: float
    checks: tuple[PlainCheck, ...]  # against plain Monte Carlo
    campaign: str  # that has these runs
    proposal: tuple[ProposalPart, ...]  # where it draws them
    later: tuple["RareRejects", ...] = ()  # of further campaigns, whose responses replace those of the earlier ones


def rare_rejects(samples: Samples, spec: ReportSpec, confidence: float) -> RareRejects | None:
    """Return the rare rejects of an importance-sampling campaign; None for other campaigns or without finished runs."""
    if not spec.proposal or not samples.sample.size:
        return None
    draws, component = _draws(samples, spec, confidence), samples.importance["component"]
    limited = [r for r in spec.responses if r.lsl is not None or r.usl is not None]
    beyond = {r.name: _beyond(samples, r) for r in limited}
    failed = ~samples.ok
    for r in limited:
        failed = failed | ~np.isfinite(samples.values[r.name])
    rejects = np.any([side for sides in beyond.values() for side in sides.values()], axis=0) if limited else failed
    w, n = draws.weights, samples.sample.size
    error = float(np.std(w, ddof=1)) / np.sqrt(n) if n > 1 else 0.0
    plain_share = 1.0 - sum(part.share for part in spec.proposal)
    checks = [
        plain_check(r.name, side, np.where(samples.ok, samples.values[r.name], np.nan), w, component == 0, plain_share)
        for r in limited
        for side in beyond[r.name]
    ]
    return RareRejects(
        runs=n,
        plain=int(np.count_nonzero(component == 0)),
        effective=float(np.sum(w) ** 2 / np.sum(w * w)),
        mean_weight=float(w.mean()),
        mean_weight_errors=float((w.mean() - 1.0) / error) if error > 0.0 else 0.0,
        responses=tuple(_response(r.name, beyond[r.name], draws) for r in limited),
        together=rare_share(rejects, draws) if limited else None,
        failed=rare_share(failed, draws),
        with_failures=rare_share(rejects | failed, draws) if limited else None,
        unseen_ppm=PPM * flat_bound(0, n, draws),
        checks=tuple(check for check in checks if check is not None),
        campaign=spec.campaign,
        proposal=spec.proposal,
    )


def rare_estimates(rare: RareRejects | None, names: Collection[str] | None = None) -> dict[str, tuple[Estimate, ...]]:
    """Return the estimates from the weighted shares on the scale of Cpk, by response; of all, or of those named."""
    if rare is None:
        return {}
    by = f"{grouped(rare.runs)} weighted runs of {rare.campaign}"
    found: dict[str, tuple[Estimate, ...]] = {
        r.response: (_estimate(r, by),)
        for r in rare.responses
        if r.total.rejects and (names is None or r.response in names)
    }
    # Without a reject only the bound by the plain runs is left, which their own count has told already; where runs were
    # made to decide, what they would have met behind a flat limit supports the other estimates.
    none = f"no reject by {by}, which would have met more than {ppm(rare.unseen_ppm)} ppm behind a flat limit"
    bound = Estimate(math.inf, (index_of_share(rare.unseen_ppm), math.inf), WEIGHTED, none)
    return found | {r.response: (bound,) for r in rare.responses if r.response in (names or ()) and not r.total.rejects}


def decisive(
    known: Mapping[str, tuple[Estimate, ...]], later: Mapping[str, tuple[Estimate, ...]]
) -> dict[str, tuple[Estimate, ...]]:
    """Return which estimates of later runs replace those known: all but a mere bound where an interval is known."""
    has_interval = {name: all(math.isfinite(e.high) for e in found) for name, found in known.items()}
    return {
        name: found
        for name, found in later.items()
        if not has_interval.get(name) or all(math.isfinite(e.high) for e in found)
    }


def plain_check(
    response: str, side: str, y: Array, weights: Array, is_plain: NDArray[np.bool_], plain_share: float
) -> PlainCheck | None:
    """Compare a weighted with a counted share of one response; None with too few plain runs."""
    seen = np.sort(y[is_plain & np.isfinite(y)] * (1.0 if side == "below" else -1.0))
    beyond = max(FEWEST_SEEN, round(SEEN * seen.size))
    if seen.size < 2 * beyond:
        return None
    at = 0.5 * (seen[beyond - 1] + seen[beyond]) * (1.0 if side == "below" else -1.0)
    rejects = (y < at if side == "below" else y > at).astype(np.float64)
    counted = rejects * is_plain / plain_share
    difference = rejects * weights - counted
    error = float(np.std(difference, ddof=1)) / np.sqrt(y.size)
    errors = float(difference.mean() / error) if error > 0.0 else 0.0
    return PlainCheck(response, side, float(at), float(counted.mean()), float((rejects * weights).mean()), errors)


def _draws(samples: Samples, spec: ReportSpec, confidence: float) -> Draws:
    component = samples.importance["component"].astype(np.int64)
    shifted = np.array([False, *(bool(part.shift) for part in spec.proposal)])
    unshifted = ~shifted[component]
    by_chance = unshifted & (samples.importance["aimed"] != 1.0)
    scales = [1.0, *(part.scale for part in spec.proposal)]
    drawn = np.bincount(component[by_chance], minlength=len(scales)) / component.size
    spreads = tuple((float(drawn[k]), scales[k]) for k in np.flatnonzero(~shifted))
    return Draws(np.exp(samples.importance["log_weight"]), by_chance, unshifted, spreads, confidence, component == 0)


def _beyond(samples: Samples, spec: ResponseSpec) -> dict[str, NDArray[np.bool_]]:
    """Return which runs lie beyond each limit, by side."""
    y = np.where(samples.ok, samples.values[spec.name], np.nan)
    sides = {} if spec.lsl is None else {"below": y < spec.lsl}
    return sides if spec.usl is None else sides | {"above": y > spec.usl}


def _response(name: str, beyond: dict[str, NDArray[np.bool_]], draws: Draws) -> RareResponse:
    sides = {side: rare_share(rejects, draws) for side, rejects in beyond.items()}
    share = max(side.ppm for side in sides.values())
    total = rare_share(np.any(list(beyond.values()), axis=0), draws)
    # Neither side has more than both together, which may be known where one side is not.
    high, low = (_index(min(max(s.interval[end] for s in sides.values()), total.interval[1])) for end in (0, 1))
    interval = (-np.inf if low is None else low, high)
    return RareResponse(name, sides.get("below"), sides.get("above"), total, _index(share), interval)


def _index(share: float) -> float | None:
    """Return the index of a share beyond one limit; None for a share of 0."""
    return index_of_share(share) if share > 0.0 else None


def _estimate(rare: RareResponse, by: str) -> Estimate:
    """Return the index of a response; if only a bound is known, the value is the high end."""
    low, high = rare.index_interval
    best, total = np.inf if high is None else high, rare.total
    least, most = (ppm(end) for end in total.interval)
    known = f"at most {most} ppm" if total.doubt else f"{ppm(total.ppm)} ppm ({least} to {most})"
    value = best if total.doubt or rare.index is None else rare.index
    return Estimate(value, (low, best), WEIGHTED, f"{known} out of limits by {by}")
