"""Capability under other distributions of the variables, by reweighting the given samples.

Every statistic is a smooth function of weighted means, so its error follows from its influence function: sample i adds
``w_i IF_i`` (delta method). `reporting.tolerance.reweighting` computes intervals from these terms.

A heavy tail of a response's own contributions widens its interval but is not a reason for a refusal: campaigns that
happen to miss the tail would pass, and their answers would be wrong. With refusals above k = 0.5, as few as 20 % of the
remaining intervals covered the true value.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, ndtri

from reporting.arrays import ROUNDING, Array, magnitude, pieces, sums
from reporting.capability.intervals import Interval
from reporting.capability.lots import LEAST_LOTS, lots_worth
from reporting.capability.shares import PPM, expected_normal
from reporting.errors import ReportError
from reporting.tolerance.reweighting import (
    Change,
    Contributions,
    LotLabels,
    Weights,
    by_lot,
    contributions,
    mean_interval,
    share_interval,
    tail_shape,
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


Influence: TypeAlias = Callable[[slice], Array]  # a range of rows to the influence of each on a statistic


@dataclass(frozen=True)
class _Sampled:
    """The samples with a value: their weights, which sum to 1, lots and effective number."""

    weight: Array
    lots: LotLabels | None
    kish: float
    doubt: Array | None = None  # of the new distributions, shape (n, k)

    def error(self, influence: Influence, confidence: float) -> float:
        """Return the half width that the new distributions' own error gives a statistic with this influence."""
        if self.doubt is None:
            return 0.0
        terms = self.weight * influence(slice(None))
        return float(ndtri(0.5 + confidence / 2) * np.linalg.norm(terms @ self.doubt))


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
    # usually every row has a value, and its weights need no copy
    weight, of_lots = (w.weight, lots) if n == y.size else (w.weight[finite], None if lots is None else lots[finite])
    with_value = float(weight.sum())
    base = WhatIf(n, y.size - n, w.effective, w.largest, w.pareto_k, w.pareto_k_bar, w.outside, 0)
    refusal = w.refusal or too_few(n, weight, of_lots)
    usual_runs = runs_for(USUAL_CPK if limited else None)
    if refusal:
        return replace(base, refusal=refusal, runs=usual_runs)
    values, weight = (y, weight) if n == y.size else (y[finite], weight / with_value)
    kish = 1 / sums(weight, lambda piece: (piece * piece,))[0]
    sampled = _Sampled(weight, of_lots, kish, None if w.doubt is None else w.doubt[finite])
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
    n, middle = y.size, y.mean()
    mean = _sum(n, lambda rows: weight[rows] * (y[rows] - middle))
    k = tail_shape(n, lambda rows: weight[rows] * np.square(y[rows] - middle - mean))
    unweighted = tail_shape(n, lambda rows: np.square(y[rows] - middle - mean))
    return k if math.isfinite(k) and k > unweighted else None


def _moments(
    y: Array, sampled: _Sampled, lsl: float | None, usl: float | None, confidence: float
) -> dict[str, Estimate | None]:
    """Return mean, sigma and indices with intervals from their influence functions."""
    weight = sampled.weight
    origin = y[int(np.argmax(weight))]  # with a large offset, sums would lose the digits of the spread
    mean = _sum(y.size, lambda rows: weight[rows] * (y[rows] - origin)) + float(origin)

    def deviation(rows: slice) -> Array:
        return y[rows] - mean

    def of_variance(rows: slice) -> Array:
        return np.square(deviation(rows)) - variance

    def of_index(side: float, index: float) -> Influence:
        return lambda rows: (side * deviation(rows) / 3 - index * (of_variance(rows) / (2 * std))) / std

    of_mean = variance_of_sum(_contributions(deviation, sampled))
    squares = _sum(y.size, lambda rows: weight[rows] * np.square(deviation(rows)))
    variance = squares + min(of_mean, squares)  # deviations are from the samples' own mean
    std = math.sqrt(variance)
    names = ("std", "cp", "cpl", "cpu", "cpk")
    if std <= ROUNDING * magnitude(y):
        return {"mean": Estimate(mean, (mean, mean), sampled.kish)} | dict.fromkeys(names)
    numbers: dict[str, Estimate | None] = dict.fromkeys(names)
    numbers["mean"] = _estimate(mean, deviation, sampled, confidence)
    spread = _estimate(variance, of_variance, sampled, confidence)
    low, high = (math.sqrt(max(end, 0.0)) for end in spread.interval)
    numbers["std"] = Estimate(std, (low, high), spread.effective)
    for name, limit, sign in (("cpl", lsl, 1.0), ("cpu", usl, -1.0)):
        if limit is not None:
            index = sign * (mean - limit) / (3 * std)
            numbers[name] = _estimate(index, of_index(sign, index), sampled, confidence)
    sides = [side for side in (numbers["cpl"], numbers["cpu"]) if side is not None]
    numbers["cpk"] = min(sides, key=lambda side: side.value) if sides else None
    if lsl is not None and usl is not None:
        cp = (usl - lsl) / (6 * std)
        numbers["cp"] = _estimate(cp, of_index(0.0, cp), sampled, confidence)
    return numbers


def _sum(n: int, of: Influence) -> float:
    """Return the sum of a function of so many rows."""
    return sum(float(np.sum(of(rows))) for rows in pieces(n))


def _contributions(influence: Influence, sampled: _Sampled) -> Contributions:
    """Return the contributions of the samples, or lots, to the error of an estimate."""
    weight = sampled.weight
    if sampled.lots is None:
        return contributions(weight.size, lambda rows: weight[rows] * influence(rows))
    terms = by_lot(weight * influence(slice(None)), sampled.lots)
    return contributions(terms.size, lambda rows: terms[rows])


def _estimate(value: float, influence: Influence, sampled: _Sampled, confidence: float) -> Estimate:
    """Return an estimate with the interval from its influence function."""
    found = _contributions(influence, sampled)
    spread = _sum(sampled.weight.size, lambda rows: sampled.weight[rows] * np.square(influence(rows)))
    effective = min(spread / found.squares, sampled.kish) if found.squares > 0 else sampled.kish
    interval = mean_interval(float(value), found, confidence)
    return Estimate(float(value), widened(value, interval, sampled.error(influence, confidence)), effective)


def _shares(
    y: Array, sampled: _Sampled, lsl: float | None, usl: float | None, outside: float, confidence: float
) -> dict[str, Estimate | None]:
    """Return the shares out of limits."""
    below = None if lsl is None else y < lsl
    above = None if usl is None else y > usl
    sides = [side for side in (below, above) if side is not None]
    both = reduce(np.logical_or, sides) if sides else None
    return {
        name: None if out is None else _share(out, sampled, outside, confidence)
        for name, out in (("ppm", both), ("ppm_below", below), ("ppm_above", above))
    }


def _share(out: NDArray[np.bool_], sampled: _Sampled, outside: float, confidence: float) -> Estimate:
    """Return a weighted share in ppm with its interval."""
    share = min(float(np.sum(sampled.weight[out])), 1.0)

    def influence(rows: slice) -> Array:
        return np.asarray(out[rows] - share, np.float64)

    error2 = _contributions(influence, sampled).squares
    effective = min(share * (1 - share) / error2, sampled.kish) if 0 < share < 1 and error2 > 0 else sampled.kish
    low, high = share_interval(out, sampled.weight, sampled.lots, confidence)
    error = sampled.error(influence, confidence)
    if error > 0 and 0 < share < 1:  # as a score: shares are not negative
        score = float(ndtri(share))
        slope = math.exp(-0.5 * score**2) / math.sqrt(2 * math.pi)
        low, high = ndtr(widened(score, (float(ndtri(low)), float(ndtri(high))), error / slope))
    return Estimate(PPM * share, (PPM * low, PPM * min(high + outside, 1.0)), effective)
