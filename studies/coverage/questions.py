"""Sensitivity of the response and of the rejects, what-if for the spread of a variable, comparison of two campaigns."""

from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from scipy.optimize import brentq
from scipy.stats import multivariate_normal, norm

from engine.arrays import Array
from reporting.comparison import compare
from reporting.sensitivity.reject_attribution import reject_attribution
from reporting.sensitivity.shapley import shapley_values
from reporting.sensitivity.summary import sensitivity
from reporting.tolerance.advice import Rows, advise
from reporting.tolerance.reweighting import Change
from reporting.tolerance.whatif import Estimate, what_if
from studies.coverage.outcomes import Statement
from studies.coverage.productions import (
    CONFIDENCE,
    RESPONSE,
    SHARES,
    VARIABLES,
    Production,
    first_order,
    moments,
    request,
    samples_of,
    truth,
)

# Closer limits than in the other modules, as scores: 2.9 % of the samples are rejects.
NEAR = (-2.5, 2.0)
FACTORS = (0.5, 0.8, 1.3)
OTHER_SPREAD, OTHER_SHIFT = 1.1, 0.2
# Present indices of both sides, and the index to keep.
PRESENT, TARGET = (1.7, 1.5), 1.33


def causes(production: Production, n: int, rng: np.random.Generator) -> Iterator[Statement]:
    """Yield the intervals of first-order indices."""
    x = production.variables(n, rng)
    (found,) = sensitivity(
        dict(zip(VARIABLES, x.T, strict=True)),
        {RESPONSE: production.values(x)},
        confidence=CONFIDENCE,
        lots=production.lot_of(n),
    ).responses
    warned = any("too narrow" in note for note in found.notes)
    for influence, value in zip(found.influences, first_order(production), strict=True):
        yield Statement(f"first order, {influence.variable}", influence.first_order_interval, value, warned)


def attributions(production: Production, n: int, rng: np.random.Generator) -> Iterator[Statement]:
    """Yield the intervals of each variable's part of the rejects, which do not depend on the response's shape."""
    x = production.variables(n, rng)
    score = x @ np.sqrt(SHARES)
    rejected = (score < NEAR[0]) | (score > NEAR[1])
    found = reject_attribution(dict(zip(VARIABLES, x.T, strict=True)), rejected, CONFIDENCE, production.lot_of(n))
    intervals = {share.variable: share.interval for share in found.shares}
    for variable, part in zip(VARIABLES, parts(), strict=True):
        yield Statement(f"part of the rejects, {variable}", intervals.get(variable), part)


@lru_cache(maxsize=1)
def parts() -> tuple[float, ...]:
    """Return each variable's Shapley effect on the event that a sample is a reject.

    The share explained by a subset of variables is the covariance of the event for two samples that share these
    variables: two normal scores whose correlation is the subset's part of the variance.
    """
    k = len(SHARES)
    members = np.arange(2**k)[:, None] >> np.arange(k) & 1
    return tuple(shapley_values(np.array([_explained(float(s)) for s in members @ np.array(SHARES)])).tolist())


@lru_cache(maxsize=64)
def _explained(correlation: float) -> float:
    """Return the correlation of the event for two scores with the given correlation."""
    low, high = NEAR
    inside = float(norm.cdf(high) - norm.cdf(low))
    # Two equal scores have no joint density.
    if correlation > 1 - 1e-9:
        return 1.0
    both = multivariate_normal([0.0, 0.0], [[1.0, correlation], [correlation, 1.0]], abseps=1e-11)
    covariance = float(both.cdf([high, high], lower_limit=[low, low])) - inside**2
    return covariance / (inside * (1 - inside))


def changes(production: Production, n: int, rng: np.random.Generator) -> Iterator[Statement]:
    """Yield the intervals of a response for another sigma of the first variable."""
    now = truth(production.shape)
    x = production.variables(n, rng)
    y = production.values(x)
    for factor in FACTORS:
        change = _change(x[:, 0], factor)
        new = truth(production.shape, _spread(factor))
        found = what_if(y, change, now.lsl, now.usl, CONFIDENCE, production.lot_of(n))
        decided = any("decide" in note for note in found.notes)
        for name, estimate, value, warned in (
            ("mean", found.mean, new.mean, False),
            ("sigma", found.std, new.std, decided),
            ("Cpk", found.cpk, new.cpk, decided),
            ("ppm", found.ppm, new.ppm, False),
        ):
            yield Statement(f"what if {factor}: {name}", _interval(estimate), value, warned)


def advice(production: Production, n: int, rng: np.random.Generator) -> Iterator[Statement]:
    """Yield the interval of the factor by which the sigma of the first variable may grow."""
    x = production.variables(n, rng)
    mean, std = moments(production.shape)
    limits = (mean - 3 * PRESENT[0] * std, mean + 3 * PRESENT[1] * std)

    def widen(_: str, factor: float, rows: Rows) -> Change:
        return _change(x[rows, 0], factor)

    (found,) = advise(
        {RESPONSE: production.values(x)},
        {RESPONSE: limits},
        {RESPONSE: TARGET},
        dict(zip(VARIABLES, x.T, strict=True)),
        VARIABLES[:1],
        widen,
        CONFIDENCE,
        production.lot_of(n),
    )
    low, high = found.interval
    given = found.factor is not None and not found.refusal
    interval = (low if low is not None else 0.0, high if high is not None else np.inf)
    yield Statement("advice: factor", interval if given else None, largest_factor(production.shape))


@lru_cache(maxsize=16)
def largest_factor(shape: str) -> float:
    """Return the factor on the first variable's sigma at which the index of a shape equals the target."""
    mean, std = moments(shape)

    def excess(factor: float) -> float:
        new_mean, new_std = moments(shape, _spread(factor))
        margins = (new_mean - mean + 3 * PRESENT[0] * std, mean + 3 * PRESENT[1] * std - new_mean)
        return min(margins) / (3 * new_std) - TARGET

    return float(brentq(excess, 1.0, 2.0))


def _change(x: Array, factor: float) -> Change:
    """Return the change of the density of a standard normal variable whose sigma is multiplied by a factor."""
    return Change(0.5 * x**2 * (1 - factor**-2) - np.log(factor), spread=factor)


def _spread(factor: float) -> float:
    """Return the sigma of the score if that of the first variable is multiplied by a factor."""
    return float(np.sqrt(1 + SHARES[0] * (factor**2 - 1)))


def _interval(estimate: Estimate | None) -> tuple[float, float] | None:
    """Return the interval of a reweighted number."""
    return None if estimate is None else estimate.interval


def differences(production: Production, n: int, rng: np.random.Generator) -> Iterator[Statement]:
    """Yield the intervals of the comparison with a campaign whose values are shifted and scaled."""
    true = truth(production.shape)
    mine, theirs = production.draw(n, rng), production.draw(n, rng)
    theirs = true.mean + OTHER_SHIFT * true.std + OTHER_SPREAD * (theirs - true.mean)
    spec = request(production, n, true)
    (found,) = compare(samples_of(production, mine), spec, samples_of(production, theirs), spec, CONFIDENCE).responses
    mean, std = true.mean + OTHER_SHIFT * true.std, OTHER_SPREAD * true.std
    cpk = min(mean - true.lsl, true.usl - mean) / (3 * std)
    yield Statement("difference of means", found.mean_interval, true.mean - mean)
    yield Statement("ratio of sigmas", found.std_ratio_interval, true.std / std)
    yield Statement("difference of Cpk", found.cpk_interval, true.cpk - cpk)
