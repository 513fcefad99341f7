"""The section Rare rejects: shares of some ppm of every response and of the product, and verdicts that follow."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from reporting import format_numbers
from reporting.capability.shares import PPM
from reporting.capability.verdict import class_of
from reporting.rare.plain_check import CHECK_BAR, PlainCheck, plain_check
from reporting.rare.weighted import Draws, RareShare, flat_bound, rare_share
from reporting.response import ResponseAnalysis
from reporting.samples import Samples
from reporting.spec import ReportSpec, ResponseSpec
from reporting.trust.check import Check

_WORST_FIRST = ("not capable", "marginal", "capable")


@dataclass(frozen=True)
class RareResponse:
    """Rare rejects of one response.

    Attributes
    ----------
    response : str
    below, above : RareShare or None
        Beyond the lower and the upper limit; None for a side without a limit.
    total : RareShare
        Beyond either.
    index : float or None
        Index with the share of the worse side, -Phi^-1(share) / 3: 1.33 at 33 ppm; None without a reject.
    index_interval : (float, float or None)
        Its interval; None for an end that no share bounds.
    verdict : str
        The word of this index; that of its lower end without a reject.
    certain : bool
        Both ends have the same word.
    """

    response: str
    below: RareShare | None
    above: RareShare | None
    total: RareShare
    index: float | None
    index_interval: tuple[float, float | None]
    verdict: str
    certain: bool


@dataclass(frozen=True)
class RareRejects:
    """What an importance campaign knows of rare rejects.

    Attributes
    ----------
    runs, plain : int
        Finished runs, and those drawn from the distributions themselves.
    effective : float
        How many runs of equal weight all runs are worth (Kish).
    mean_weight, mean_weight_errors : float
        Mean weight, and its distance from 1 in standard errors.
    responses : tuple of RareResponse
        Responses with limits.
    together : RareShare or None
        Beyond any limit of any response; None without limits.
    failed : RareShare
        Runs that failed, or have no value of a response with limits.
    with_failures : RareShare or None
        Beyond any limit, or failed; None without limits.
    unseen_ppm : float
        A region of rejects behind a flat limit that held more would have been met by chance [ppm].
    checks : tuple of PlainCheck
        Against plain Monte Carlo.
    """

    runs: int
    plain: int
    effective: float
    mean_weight: float
    mean_weight_errors: float
    responses: tuple[RareResponse, ...]
    together: RareShare | None
    failed: RareShare
    with_failures: RareShare | None
    unseen_ppm: float
    checks: tuple[PlainCheck, ...]


def rare_rejects(samples: Samples, spec: ReportSpec, confidence: float) -> RareRejects | None:
    """Return the rare rejects of an importance campaign; None for other campaigns, or without a finished run."""
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
    )


def judged(responses: tuple[ResponseAnalysis, ...], rare: RareRejects | None) -> tuple[ResponseAnalysis, ...]:
    """Return the responses with the worse of two verdicts: that of the plain runs' Cpk, and that of the rare share."""
    shares = {r.response: r for r in rare.responses} if rare else {}
    return tuple(_worse(r, shares[r.spec.name]) if r.spec.name in shares else r for r in responses)


def rare_checks(rare: RareRejects | None) -> tuple[Check, ...]:
    """Return the lines of the trust card on rare rejects: whether they are known, and whether the weights are right."""
    if rare is None:
        return ()
    return (_known(rare), _agrees(rare))


def _draws(samples: Samples, spec: ReportSpec, confidence: float) -> Draws:
    """Return how the runs were drawn."""
    component = samples.importance["component"].astype(np.int64)
    shifted = np.array([False, *(bool(part.shift) for part in spec.proposal)])
    unshifted = ~shifted[component]
    by_chance = unshifted & (samples.importance["aimed"] != 1.0)
    scales = [1.0, *(part.scale for part in spec.proposal)]
    drawn = np.bincount(component[by_chance], minlength=len(scales)) / component.size
    spreads = tuple((float(drawn[k]), scales[k]) for k in np.flatnonzero(~shifted))
    return Draws(np.exp(samples.importance["log_weight"]), by_chance, unshifted, spreads, confidence)


def _beyond(samples: Samples, spec: ResponseSpec) -> dict[str, NDArray[np.bool_]]:
    """Return which runs lie beyond each limit, by side."""
    y = np.where(samples.ok, samples.values[spec.name], np.nan)
    sides = {"below": None if spec.lsl is None else y < spec.lsl, "above": None if spec.usl is None else y > spec.usl}
    return {side: rejects for side, rejects in sides.items() if rejects is not None}


def _response(name: str, beyond: dict[str, NDArray[np.bool_]], draws: Draws) -> RareResponse:
    """Return the rare rejects of one response."""
    sides = {side: rare_share(rejects, draws) for side, rejects in beyond.items()}
    share = max(side.ppm for side in sides.values())
    ends = [max(side.interval[end] for side in sides.values()) for end in (0, 1)]
    high, low = (_index(end) for end in ends)
    index = _index(share)
    lowest = -np.inf if low is None else low
    word = class_of(lowest if index is None else index)
    certain = class_of(lowest) == word and (word == "capable" or (high is not None and class_of(high) == word))
    total = rare_share(np.any(list(beyond.values()), axis=0), draws)
    return RareResponse(name, sides.get("below"), sides.get("above"), total, index, (lowest, high), word, certain)


def _index(ppm: float) -> float | None:
    """Return the index of a share beyond one limit; None for none."""
    return None if ppm <= 0.0 else float(-ndtri(min(ppm / PPM, 1.0 - 1e-16))) / 3.0


def _worse(response: ResponseAnalysis, rare: RareResponse) -> ResponseAnalysis:
    """Return the response with the worse word; it is certain if every verdict that gives this word is."""
    if response.verdict not in _WORST_FIRST:
        return replace(response, verdict=rare.verdict, certain=rare.certain)
    word = min(response.verdict, rare.verdict, key=_WORST_FIRST.index)
    given = ((response.verdict, response.certain), (rare.verdict, rare.certain))
    return replace(response, verdict=word, certain=all(certain for verdict, certain in given if verdict == word))


def _known(rare: RareRejects) -> Check:
    """Check that the share of every response is supported by its weights."""
    name, shares = "Rare rejects", {r.response: r.total for r in rare.responses}
    if not shares:
        return Check(name, "info", "No response has limits.")
    doubts = [f"{response}: {share.doubt}" for response, share in shares.items() if share.doubt]
    if doubts:
        text = f"Only upper bounds are known of {'; '.join(doubts)}. clearcap design aims better, with these runs."
        return Check(name, "attention", text, float(len(doubts)))
    found = {response: share for response, share in shares.items() if share.rejects}
    none = [response for response in shares if response not in found]
    text = f"Weighted over {format_numbers.grouped(rare.runs)} runs."
    if found:
        widest = max(found, key=lambda response: found[response].standard_error or 0.0)
        error = format_numbers.percent(found[widest].standard_error or 0.0)
        text += f" Shares are known to a standard error of {error} or better (widest: {widest})."
    if none:
        text += f" No reject of {', '.join(none)} was met: below {format_numbers.ppm(rare.unseen_ppm)} ppm."
    return Check(name, "good", text)


def _agrees(rare: RareRejects) -> Check:
    """Check weighted shares against counted ones, and the mean weight against 1."""
    name = "Weights"
    errors = {f"{check.response} {check.side} {check.at:.6g}": abs(check.errors) for check in rare.checks}
    errors["the mean weight and 1"] = abs(rare.mean_weight_errors)
    worst = max(errors, key=errors.__getitem__)
    distance = format_numbers.fixed(errors[worst], 1, (CHECK_BAR,))
    text = (
        f"Weighted shares and those that the {format_numbers.grouped(rare.plain)} plain runs count differ by at most"
        f" {distance} standard errors, at {len(rare.checks)} limits moved to where both see rejects (largest: {worst})"
    )
    if errors[worst] <= CHECK_BAR:
        return Check(name, "good", f"{text}.", errors[worst])
    return Check(name, "bad", f"{text}: the weights do not fit the runs.", errors[worst])
