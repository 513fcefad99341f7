"""The capability under other distributions of the variables, from the samples at hand: reweighting.

Every statistic is a smooth function of weighted means, so its standard error follows from its influence function,
``se^2 = sum (w_i IF_i)^2`` (delta method). Shares have the interval of Korn and Graubard (1998): that of Clopper and
Pearson for the sample size with the same standard error.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from reporting.arrays import Array
from reporting.capability.intervals import Interval, share_interval
from reporting.capability.moments import ROUNDING
from reporting.capability.shares import PPM, expected_normal
from reporting.errors import ReportError
from reporting.tolerance.reweighting import Change, Weights, pareto_smoothed, weights

USUAL_CPK = 1.33
WANTED_HALF_WIDTH = 0.05


@dataclass(frozen=True)
class Estimate:
    """A reweighted number.

    Attributes
    ----------
    value : float
    interval : (float, float)
    effective : float
        Number of new runs that would give an interval as narrow.
    """

    value: float
    interval: Interval
    effective: float


@dataclass(frozen=True)
class WhatIf:
    """A response under the new distributions; a number is None where it is undefined or refused.

    Attributes
    ----------
    n, dropped : int
        Number of finite values, and of rows without one.
    effective, largest : float
        Kish's effective sample size, and the largest weight of a sample.
    pareto_k, pareto_k_sigma, pareto_k_bar : float or None
        Shape of the tail of the weights, of the samples' contributions to sigma, and the largest that is accepted.
    outside : float
        Probability of new values outside the range of the old distribution.
    mean, std : Estimate or None
        In the response's unit.
    cp, cpl, cpu, cpk : Estimate or None
    ppm, ppm_below, ppm_above : Estimate or None
        Weighted share out of limits; the upper end of the interval includes `outside`.
    ppm_expected : float or None
        Share out of limits of a normal distribution with the new mean and sigma.
    missing : float or None
        Weighted share of rows without a value: the share of failures under the new distributions.
    refusal : str
        Why there are no numbers; empty if there are.
    runs : int
        Number of new runs that determine Cpk (without limits: sigma) to 5 %.
    notes : tuple of str
    """

    n: int
    dropped: int
    effective: float
    largest: float
    pareto_k: float | None
    pareto_k_bar: float
    outside: float
    runs: int
    pareto_k_sigma: float | None = None
    mean: Estimate | None = None
    std: Estimate | None = None
    cp: Estimate | None = None
    cpl: Estimate | None = None
    cpu: Estimate | None = None
    cpk: Estimate | None = None
    ppm: Estimate | None = None
    ppm_below: Estimate | None = None
    ppm_above: Estimate | None = None
    ppm_expected: float | None = None
    missing: float | None = None
    refusal: str = ""
    notes: tuple[str, ...] = ()


def what_if(
    y: ArrayLike,
    change: Change,
    lsl: float | None = None,
    usl: float | None = None,
    confidence: float = 0.95,
) -> WhatIf:
    """Return the capability of one response under a change of the variables' distributions.

    Parameters
    ----------
    y : array_like, shape (n,)
        The response at each sample; NaN where it has none.
    change : Change
        Log ratio of the densities at the same samples.
    lsl, usl : float or None
        Limits, in the response's unit.
    confidence : float
        Of the intervals, two-sided.

    Raises
    ------
    ReportError
        Response and log ratios differ in length, or a log ratio is not a number.
    """
    return _under(np.asarray(y, np.float64), weights(change), lsl, usl, confidence)


def what_if_all(
    responses: Mapping[str, ArrayLike],
    change: Change,
    limits: Mapping[str, tuple[float | None, float | None]] | None = None,
    confidence: float = 0.95,
) -> dict[str, WhatIf]:
    """Return `what_if` of every response, with weights that are computed once."""
    w = weights(change)
    return {
        name: _under(np.asarray(column, np.float64), w, *(limits or {}).get(name, (None, None)), confidence)
        for name, column in responses.items()
    }


def runs_for(cpk: float | None, half_width: float = WANTED_HALF_WIDTH, confidence: float = 0.95) -> int:
    """Return the number of new runs that determine Cpk, or sigma for None, to a relative half width (Bissell 1990)."""
    location = 0.0 if cpk is None else 1 / (9 * max(abs(cpk), 1.0) ** 2)
    return math.ceil((float(ndtri(0.5 + confidence / 2)) / half_width) ** 2 * (location + 0.5))


def _under(y: Array, w: Weights, lsl: float | None, usl: float | None, confidence: float) -> WhatIf:
    """Return the numbers of one response under weights."""
    if y.shape != w.weight.shape:
        raise ReportError(f"what if: {y.shape} values and {w.weight.shape} weights; give both of the same samples")
    finite = np.isfinite(y)
    n, limited = int(np.count_nonzero(finite)), lsl is not None or usl is not None
    with_value = float(w.weight[finite].sum())
    base = WhatIf(n, y.size - n, w.effective, w.largest, w.pareto_k, w.pareto_k_bar, w.outside, 0)
    empty = "no sample with a value has a weight above zero" if n < 2 or with_value <= 0 else ""
    usual_runs = runs_for(USUAL_CPK if limited else None)
    if w.refusal or empty:
        return replace(base, refusal=w.refusal or empty, runs=usual_runs)
    values, weight = y[finite], w.weight[finite] / with_value
    k = _tail_of_sigma(values, weight)
    if k is not None and k > w.pareto_k_bar:
        why = f"a few samples determine the new sigma, Pareto k = {k:.2f} above {w.pareto_k_bar:.2f}"
        return replace(base, pareto_k_sigma=k, refusal=why, runs=usual_runs)
    numbers: dict[str, Any] = _moments(values, weight, lsl, usl, float(ndtri(0.5 + confidence / 2)))
    numbers |= _shares(values, weight, lsl, usl, w.outside, confidence)
    mean, std, cpk = numbers["mean"], numbers["std"], numbers["cpk"]
    notes = () if std else ("All values are equal: the spread is zero, so there is no index and no expected ppm.",)
    return replace(
        base,
        **numbers,
        ppm_expected=expected_normal(mean.value, std.value, lsl, usl).get("total") if mean and std else None,
        pareto_k_sigma=k,
        missing=max(1.0 - with_value, 0.0) if n < y.size else 0.0,
        runs=runs_for(cpk.value) if cpk else usual_runs,
        notes=notes if limited else (*notes, "Without limits there is no index and no share out of limits."),
    )


def _tail_of_sigma(y: Array, weight: Array) -> float | None:
    """Return the tail's shape of the contributions to the variance; None if the weights do not make it heavier."""
    deviation = y - y.mean()
    squares = (deviation - np.sum(weight * deviation)) ** 2
    k, unweighted = pareto_smoothed(weight * squares)[1], pareto_smoothed(squares)[1]
    return k if math.isfinite(k) and k > unweighted else None


def _moments(
    y: Array, weight: Array, lsl: float | None, usl: float | None, z: float
) -> dict[str, Estimate | None]:  # fmt: skip
    """Return mean, sigma and indices with the intervals of their influence functions."""
    origin = y[int(np.argmax(weight))]  # sums over a large offset would lose the digits of the spread
    mean = float(np.sum(weight * (y - origin))) + float(origin)
    deviation = y - mean
    variance = float(np.sum(weight * deviation**2)) / max(1 - float(np.sum(weight**2)), 0.5)
    std = math.sqrt(variance)
    names = ("std", "cp", "cpl", "cpu", "cpk")
    if std <= ROUNDING * float(np.abs(y).max()):
        return {"mean": Estimate(mean, (mean, mean), float(y.size))} | dict.fromkeys(names)
    of_std = (deviation**2 - variance) / (2 * std)
    numbers: dict[str, Estimate | None] = dict.fromkeys(names)
    numbers["mean"] = _estimate(mean, deviation, weight, z)
    numbers["std"] = _estimate(std, of_std, weight, z)
    for name, limit, sign in (("cpl", lsl, 1.0), ("cpu", usl, -1.0)):
        if limit is not None:
            index = sign * (mean - limit) / (3 * std)
            numbers[name] = _estimate(index, (sign * deviation / 3 - index * of_std) / std, weight, z)
    sides = [side for side in (numbers["cpl"], numbers["cpu"]) if side is not None]
    numbers["cpk"] = min(sides, key=lambda side: side.value) if sides else None
    if lsl is not None and usl is not None:
        cp = (usl - lsl) / (6 * std)
        numbers["cp"] = _estimate(cp, -cp / std * of_std, weight, z)
    return numbers


def _estimate(value: float, influence: Array, weight: Array, z: float) -> Estimate:
    """Return an estimate with the interval of its influence function."""
    error = math.sqrt(float(np.sum((weight * influence) ** 2)))
    spread = float(np.sum(weight * influence**2))
    effective = spread / error**2 if error > 0 else float(weight.size)
    return Estimate(float(value), (float(value - z * error), float(value + z * error)), effective)


def _shares(
    y: Array, weight: Array, lsl: float | None, usl: float | None, outside: float, confidence: float
) -> dict[str, Estimate | None]:
    """Return the shares out of limits."""
    below = None if lsl is None else y < lsl
    above = None if usl is None else y > usl
    sides = [side for side in (below, above) if side is not None]
    both = np.any(sides, axis=0) if sides else None
    return {
        name: None if out is None else _share(out, weight, outside, confidence)
        for name, out in (("ppm", both), ("ppm_below", below), ("ppm_above", above))
    }


def _share(out: NDArray[np.bool_], weight: Array, outside: float, confidence: float) -> Estimate:
    """Return a weighted share in ppm with the interval of Korn and Graubard."""
    share = min(float(np.sum(weight[out])), 1.0)
    error2 = float(np.sum((weight * (out - share)) ** 2))
    kish = 1 / float(np.sum(weight**2))
    effective = share * (1 - share) / error2 if 0 < share < 1 and error2 > 0 else kish
    low, high = share_interval(share * effective, effective, confidence)
    return Estimate(PPM * share, (PPM * low, PPM * min(high + outside, 1.0)), effective)
