"""Capability under other distributions of the variables, by reweighting the given samples.

Every statistic is a smooth function of weighted means, so its error follows from its influence function: sample i adds
``w_i IF_i`` (delta method). `reporting.tolerance.reweighting` computes intervals from these terms.

A heavy tail of a response's own contributions widens its interval but is not a reason for a refusal: campaigns that
happen to miss the tail would pass, and their answers would be wrong. With refusals above k = 0.5, as few as 20 % of the
remaining intervals covered the true value.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, ndtri

from reporting.arrays import ROUNDING, Array
from reporting.capability.intervals import Interval
from reporting.capability.lots import LEAST_LOTS, lots_worth
from reporting.capability.shares import PPM, expected_normal
from reporting.errors import ReportError
from reporting.tolerance.reweighting import (
    Change,
    LotLabels,
    Weights,
    by_lot,
    mean_interval,
    pareto_smoothed,
    share_interval,
    variance_of_sum,
    weights,
    widened,
)

USUAL_CPK = 1.33
WANTED_HALF_WIDTH = 0.05
# Above this shape of the tail a few samples decide a mean (Vehtari et al. 2024).
HEAVY_TAIL = 0.7


@dataclass(frozen=True)
class Estimate:
    """A reweighted number."""

    value: float
    interval: Interval
    effective: float  # number of new runs that would give the same error, at most Kish's effective sample size


@dataclass(frozen=True)
class WhatIf:
    """A response under the new distributions; a number is None where it is undefined or refused."""

    n: int  # finite values
    dropped: int  # rows without a finite value
    effective: float  # Kish's sample size
    largest: float  # weight of a sample
    pareto_k: float | None  # shape of the tail of the weights
    pareto_k_bar: float  # largest accepted shape
    outside: float  # probability of new values outside the range of the old distribution
    runs: int  # new runs that determine Cpk (without limits: sigma) to 5 %
    # shape of the tail of the contributions to sigma; None if the weights do not make it heavier
    pareto_k_sigma: float | None = None
    mean: Estimate | None = None  # in the response's unit
    std: Estimate | None = None  # in the response's unit
    cp: Estimate | None = None
    cpl: Estimate | None = None
    cpu: Estimate | None = None
    cpk: Estimate | None = None
    # Weighted share out of limits; the upper end of the interval includes `outside`. If rejects have small weights, the
    # value may be far below one effective sample: then only the upper end of the interval is informative.
    ppm: Estimate | None = None
    ppm_below: Estimate | None = None
    ppm_above: Estimate | None = None
    ppm_expected: float | None = None  # out of limits, of a normal distribution with the new mean and sigma
    missing: float | None = None  # weighted share of rows without a value: the failures under the new distributions
    refusal: str = ""  # why there are no numbers; empty if there are
    emulated: str = ""  # why an emulator of the rows gives the numbers, and not their weights; empty if they do
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Sampled:
    """The samples with a value: their weights, which sum to 1, lots and effective number."""

    weight: Array
    lots: LotLabels | None
    kish: float
    doubt: Array | None = None  # of the new distributions, shape (n, k)

    def error(self, influence: Array, confidence: float) -> float:
        """Return the half width that the new distributions' own error gives a statistic with this influence."""
        if self.doubt is None:
            return 0.0
        return float(ndtri(0.5 + confidence / 2) * np.linalg.norm((self.weight * influence) @ self.doubt))


def what_if(
    y: ArrayLike,
    change: Change,
    lsl: float | None = None,
    usl: float | None = None,
    confidence: float = 0.95,
    lots: LotLabels | None = None,
) -> WhatIf:
    """Return the capability of one response, NaN where it has no value, under a change of the variables' distributions.

    Response, lots and log ratios, shape (n,), belong to the same samples. ReportError: they differ in length, or a log
    ratio is not a number.
    """
    return _under(np.asarray(y, np.float64), weights(change), (lsl, usl), confidence, lots)


def what_if_all(
    responses: Mapping[str, ArrayLike],
    change: Change,
    limits: Mapping[str, tuple[float | None, float | None]] | None = None,
    confidence: float = 0.95,
    lots: LotLabels | None = None,
) -> dict[str, WhatIf]:
    """Return the result of `what_if` for every response; the weights are computed once."""
    w = weights(change)
    return {
        name: _under(np.asarray(column, np.float64), w, (limits or {}).get(name, (None, None)), confidence, lots)
        for name, column in responses.items()
    }


def runs_for(cpk: float | None, half_width: float = WANTED_HALF_WIDTH, confidence: float = 0.95) -> int:
    """Return the number of new runs that determine Cpk, or sigma for None, to a relative half width (Bissell 1990)."""
    location = 0.0 if cpk is None else 1 / (9 * max(abs(cpk), 1.0) ** 2)
    return math.ceil((float(ndtri(0.5 + confidence / 2)) / half_width) ** 2 * (location + 0.5))


def _under(
    y: Array, w: Weights, limits: tuple[float | None, float | None], confidence: float, lots: LotLabels | None
) -> WhatIf:
    """Return the numbers of one response under weights."""
    if y.shape != w.weight.shape or (lots is not None and np.shape(lots) != y.shape):
        raise ReportError(f"what if: {y.shape} values and {w.weight.shape} weights; give both of the same samples")
    finite = np.isfinite(y)
    n, limited = int(np.count_nonzero(finite)), limits != (None, None)
    with_value = float(w.weight[finite].sum())
    base = WhatIf(n, y.size - n, w.effective, w.largest, w.pareto_k, w.pareto_k_bar, w.outside, 0)
    refusal = w.refusal or too_few(n, w.weight[finite], None if lots is None else lots[finite])
    usual_runs = runs_for(USUAL_CPK if limited else None)
    if refusal:
        return replace(base, refusal=refusal, runs=usual_runs)
    values, weight = y[finite], w.weight[finite] / with_value
    sampled = _Sampled(
        weight,
        None if lots is None else lots[finite],
        float(1 / np.sum(weight**2)),
        None if w.doubt is None else w.doubt[finite],
    )
    k = _tail_of_sigma(values, weight)
    numbers: dict[str, Any] = _moments(values, sampled, *limits, confidence)
    numbers |= _shares(values, sampled, *limits, w.outside, confidence)
    mean, std, cpk = numbers["mean"], numbers["std"], numbers["cpk"]
    return replace(
        base,
        **numbers,
        ppm_expected=expected_normal(mean.value, std.value, *limits).get("total") if std else None,
        pareto_k_sigma=k,
        # Exactly 0 if every row has a value: the weights add up to 1 only within rounding.
        missing=max(1.0 - with_value, 0.0) if n < y.size else 0.0,
        runs=runs_for(cpk.value) if cpk else usual_runs,
        notes=tuple(_notes(std is not None, limited, k)),
    )


def too_few(n: int, weight: Array, lots: LotLabels | None) -> str:
    """Return why the samples with a value do not suffice; empty if they do."""
    if n < 2 or weight.sum() <= 0:
        return "no sample with a value has a weight above zero"
    worth = LEAST_LOTS if lots is None else lots_worth(by_lot(weight, lots))
    return "" if worth >= LEAST_LOTS else f"the samples are worth {worth:.2g} production lots; {LEAST_LOTS} are needed"


def _notes(varies: bool, limited: bool, k: float | None) -> Iterator[str]:
    """Yield the limitations of the answer."""
    if not varies:
        yield "All values are equal: the spread is zero, so there is no index and no expected ppm."
    if k is not None and k > HEAVY_TAIL:
        yield f"A few samples decide the new sigma (Pareto k = {k:.2f}), so its interval and that of Cpk are wide."
    if not limited:
        yield "Without limits there is no index and no share out of limits."


def _tail_of_sigma(y: Array, weight: Array) -> float | None:
    """Return the tail shape of the contributions to the variance; None if the weights do not make it heavier."""
    deviation = y - y.mean()
    squares = (deviation - np.sum(weight * deviation)) ** 2
    k, unweighted = pareto_smoothed(weight * squares)[1], pareto_smoothed(squares)[1]
    return k if math.isfinite(k) and k > unweighted else None


def _moments(
    y: Array, sampled: _Sampled, lsl: float | None, usl: float | None, confidence: float
) -> dict[str, Estimate | None]:
    """Return mean, sigma and indices with intervals from their influence functions."""
    weight = sampled.weight
    origin = y[int(np.argmax(weight))]  # with a large offset, sums would lose the digits of the spread
    mean = float(np.sum(weight * (y - origin))) + float(origin)
    deviation = y - mean
    of_mean = variance_of_sum(by_lot(weight * deviation, sampled.lots))
    squares = float(np.sum(weight * deviation**2))
    variance = squares + min(of_mean, squares)  # deviations are from the samples' own mean
    std = math.sqrt(variance)
    names = ("std", "cp", "cpl", "cpu", "cpk")
    if std <= ROUNDING * float(np.abs(y).max()):
        return {"mean": Estimate(mean, (mean, mean), sampled.kish)} | dict.fromkeys(names)
    of_variance = deviation**2 - variance
    of_std = of_variance / (2 * std)
    numbers: dict[str, Estimate | None] = dict.fromkeys(names)
    numbers["mean"] = _estimate(mean, deviation, sampled, confidence)
    spread = _estimate(variance, of_variance, sampled, confidence)
    low, high = (math.sqrt(max(end, 0.0)) for end in spread.interval)
    numbers["std"] = Estimate(std, (low, high), spread.effective)
    for name, limit, sign in (("cpl", lsl, 1.0), ("cpu", usl, -1.0)):
        if limit is not None:
            index = sign * (mean - limit) / (3 * std)
            numbers[name] = _estimate(index, (sign * deviation / 3 - index * of_std) / std, sampled, confidence)
    sides = [side for side in (numbers["cpl"], numbers["cpu"]) if side is not None]
    numbers["cpk"] = min(sides, key=lambda side: side.value) if sides else None
    if lsl is not None and usl is not None:
        cp = (usl - lsl) / (6 * std)
        numbers["cp"] = _estimate(cp, -cp / std * of_std, sampled, confidence)
    return numbers


def _estimate(value: float, influence: Array, sampled: _Sampled, confidence: float) -> Estimate:
    """Return an estimate with the interval from its influence function."""
    terms = by_lot(sampled.weight * influence, sampled.lots)
    error2 = float(np.sum(terms**2))
    spread = float(np.sum(sampled.weight * influence**2))
    effective = min(spread / error2, sampled.kish) if error2 > 0 else sampled.kish
    interval = mean_interval(float(value), terms, confidence)
    return Estimate(float(value), widened(value, interval, sampled.error(influence, confidence)), effective)


def _shares(
    y: Array, sampled: _Sampled, lsl: float | None, usl: float | None, outside: float, confidence: float
) -> dict[str, Estimate | None]:
    """Return the shares out of limits."""
    below = None if lsl is None else y < lsl
    above = None if usl is None else y > usl
    sides = [side for side in (below, above) if side is not None]
    both = np.any(sides, axis=0) if sides else None
    return {
        name: None if out is None else _share(out, sampled, outside, confidence)
        for name, out in (("ppm", both), ("ppm_below", below), ("ppm_above", above))
    }


def _share(out: NDArray[np.bool_], sampled: _Sampled, outside: float, confidence: float) -> Estimate:
    """Return a weighted share in ppm with its interval."""
    share = min(float(np.sum(sampled.weight[out])), 1.0)
    error2 = float(np.sum(by_lot(sampled.weight * (out - share), sampled.lots) ** 2))
    effective = min(share * (1 - share) / error2, sampled.kish) if 0 < share < 1 and error2 > 0 else sampled.kish
    low, high = share_interval(out, sampled.weight, sampled.lots, confidence)
    if (
        error := sampled.error(np.asarray(out - share, np.float64), confidence)
    ) > 0 and 0 < share < 1:  # as a score: shares are not negative
        score = float(ndtri(share))
        slope = math.exp(-0.5 * score**2) / math.sqrt(2 * math.pi)
        low, high = ndtr(widened(score, (float(ndtri(low)), float(ndtri(high))), error / slope))
    return Estimate(PPM * share, (PPM * low, PPM * min(high + outside, 1.0)), effective)
