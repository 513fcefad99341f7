"""The section Rare rejects: shares of a few ppm, for every response and for the whole product.

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

from reporting.arrays import Array
from reporting.capability.shares import PPM
from reporting.capability.verdict import WEIGHTED, IndexEstimate, index_of_share
from reporting.format_numbers import grouped, ppm
from reporting.rare.weighted import Draws, RareShare, flat_bound, rare_share
from reporting.samples import Samples
from reporting.spec import ProposalPart, ReportSpec, ResponseSpec

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


def rare_estimates(
    rare: RareRejects | None, names: Collection[str] | None = None
) -> dict[str, tuple[IndexEstimate, ...]]:
    """Return the estimates from the weighted shares on the scale of Cpk, by response; of all, or of those named."""
    if rare is None:
        return {}
    by = f"{grouped(rare.runs)} weighted runs of {rare.campaign}"
    found: dict[str, tuple[IndexEstimate, ...]] = {
        r.response: (IndexEstimate(WEIGHTED, *_ends(r), f"{_words(r.total)} by {by}"),)
        for r in rare.responses
        if r.total.rejects and (names is None or r.response in names)
    }
    # Without a reject only the bound by the plain runs is left, which their own count has told already; where runs were
    # made to decide, what they would have met behind a flat limit supports the other estimates.
    none = f"no reject by {by}, which would have met more than {ppm(rare.unseen_ppm)} ppm behind a flat limit"
    bound = IndexEstimate(WEIGHTED, index_of_share(rare.unseen_ppm), math.inf, math.inf, none)
    return found | {r.response: (bound,) for r in rare.responses if r.response in (names or ()) and not r.total.rejects}


def decisive(
    known: Mapping[str, tuple[IndexEstimate, ...]], later: Mapping[str, tuple[IndexEstimate, ...]]
) -> dict[str, tuple[IndexEstimate, ...]]:
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
    """Compare a weighted with a counted share of one response; None with too few plain runs.

    `y`, shape (n,), is NaN where a run has none; `plain_share` is the planned share of plain runs.
    """
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
    """Return how the runs were drawn."""
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
    sides = {"below": None if spec.lsl is None else y < spec.lsl, "above": None if spec.usl is None else y > spec.usl}
    return {side: rejects for side, rejects in sides.items() if rejects is not None}


def _response(name: str, beyond: dict[str, NDArray[np.bool_]], draws: Draws) -> RareResponse:
    """Return the rare rejects of one response."""
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


def _ends(rare: RareResponse) -> tuple[float, float, float]:
    """Return low end, value and high end of the index; if only a bound is known, the value is the high end."""
    low, high = rare.index_interval
    best = np.inf if high is None else high
    return low, best if rare.total.doubt or rare.index is None else rare.index, best


def _words(share: RareShare) -> str:
    """Return a share in words."""
    low, high = (ppm(end) for end in share.interval)
    known = f"at most {high} ppm" if share.doubt else f"{ppm(share.ppm)} ppm ({low} to {high})"
    return f"{known} out of limits"
