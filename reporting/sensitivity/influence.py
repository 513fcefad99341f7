"""The measures of sensitivity of all responses, and the verdicts: which variable is critical for which response.

A variable is *critical* for a response if the interval of its share of the variance begins at a tenth or above, and
chance is excluded (Bonferroni over the variables). It is *not critical* if the interval ends below a tenth, and
interactions that no total-order index covers hold less than a tenth. Otherwise it is *open*. The share is the
total-order index if a design gives one, the Shapley effect if variables are correlated, the total effect by a
regression with products where interactions may matter, else the first-order index.

A correlated variable is critical only if it also acts itself, that is, with all others fixed it causes at least 1 % of
the variance. A variable that has a tenth, but certainly causes less than 1 % itself, is *only correlated*.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from reporting.arrays import Array, Columns, random_rows, varies
from reporting.capability.intervals import Interval
from reporting.capability.lots import LEAST_LOTS
from reporting.sensitivity.first_order import Effects, effects, jackknife_quantile, most_degree
from reporting.sensitivity.polynomials import GROUPS, group_sums, groups_of
from reporting.sensitivity.regression import Linear, Rank, linear, rank
from reporting.sensitivity.reject_attribution import RejectAttribution, RejectCauses, WorstSample
from reporting.sensitivity.shapley_effects import ShapleyEffects, TotalEffects, shapley_effects, total_effects
from reporting.sensitivity.total_order import TotalOrder

CRITICAL_SHARE = 0.10  # of the variance
_CONTRADICTION = 5.0  # standard errors at which samples contradict the requested correlations


@dataclass(frozen=True)
class Measures:
    """The measures of sensitivity of m responses to k variables, over the same rows."""

    variables: dict[str, int]  # position of each varying variable in the arrays
    responses: dict[str, int]  # likewise
    mean: Array  # of the responses, in their units, shape (m,)
    std: Array  # like `mean`
    linear: Linear
    rank: Rank
    effects: Effects  # first-order indices and conditional expectations
    groups: int  # of rows, from which errors are estimated
    independent: bool  # no correlation of the variables is requested or beyond chance
    shapley: ShapleyEffects | None  # effects of up to 10 correlated variables; None otherwise
    # With their interactions, of up to 10 independent variables, by the position of the response: where interactions
    # may matter, or are found beyond chance.
    totals: Mapping[int, TotalEffects]


def measure(
    columns: Columns,
    values: Columns,
    confidence: float,
    correlations: Sequence[tuple[str, str, float]] | None = None,
    lots: NDArray[np.generic] | None = None,
) -> Measures | None:
    """Return all measures of finite columns, shape (n,), that vary; None for too few rows, or if no value varies."""
    # `correlations` are the requested ones; if not given, the samples decide. The shifts of `lots` correlate variables
    # by chance; with `LEAST_LOTS` lots or more, errors are estimated by leaving out whole lots.
    x_names, y_names = list(columns), [name for name, column in values.items() if varies(column)]
    if not x_names or not y_names:
        return None
    n = next(iter(values.values())).size
    if n < fewest_rows(len(x_names)):
        return None
    rows = random_rows(n)
    x = np.column_stack([columns.take(name, rows) for name in x_names])
    y = np.column_stack([values.take(name, rows) for name in y_names])
    count = rows.size if lots is None else np.unique(lots[rows]).size
    group = groups_of(rows.size, None if lots is None or count < LEAST_LOTS else lots[rows])
    sums = group_sums(x, y, most_degree(rows.size, len(x_names)), group)
    regression = linear(sums)
    independent = _independent(regression.correlation, x_names, correlations, count)
    ends = np.quantile(x, [0.05, 0.95], axis=0)
    alone = effects(sums, x, y, group, (ends[0], ends[1]), independent=independent)
    half = jackknife_quantile(sums.rows.size, confidence) * alone.unexplained_error
    asked = (alone.unexplained > half) | (alone.unexplained + half >= CRITICAL_SHARE)
    at = np.flatnonzero(asked).tolist() if independent else []
    totals = dict(zip(at, total_effects(x, y[:, at], group), strict=False))  # none of many variables
    return Measures(
        variables={name: i for i, name in enumerate(x_names)},
        responses={name: i for i, name in enumerate(y_names)},
        mean=y.mean(axis=0),
        std=y.std(axis=0),
        linear=regression,
        rank=rank(x, y, confidence),
        effects=replace(alone, residual_carriers=np.minimum(alone.residual_carriers, count)),
        groups=sums.rows.size,
        independent=independent,
        shapley=None if independent else shapley_effects(x, y, group, regression.inflation),
        totals=totals,
    )


def _independent(
    found: Array, names: list[str], requested: Sequence[tuple[str, str, float]] | None, independent_rows: int
) -> bool:
    """Return whether the variables are independent: no correlation is requested, and the samples do not show one."""
    # Chance alone must not make variables count as correlated: 5 standard errors are needed to contradict a request,
    # and a p-value of 1 % over all pairs if the request is unknown.
    if any(rank != 0 and {a, b} <= set(names) for a, b, rank in requested or ()):
        return False
    k = len(names)
    largest = float(np.abs(found - np.eye(k)).max())
    pairs = max(k * (k - 1) // 2, 1)
    errors = float(ndtri(1 - 0.005 / pairs)) if requested is None else _CONTRADICTION
    return bool(largest <= errors / np.sqrt(independent_rows))


def fewest_rows(variables: int) -> int:
    """Return the smallest number of rows for a regression: two per group and five per coefficient."""
    return max(2 * GROUPS, 5 * (variables + 1))


NEGLIGIBLE_SHARE = 0.001
FEWEST_CARRIERS = 12
CRITICAL, NOT_CRITICAL, OPEN, CORRELATED = "critical", "not critical", "open", "only correlated"
OWN_EFFECT = 0.01  # share of the variance from which on a variable acts itself
POLYNOMIAL, RANKS = "polynomial", "ranks"


@dataclass(frozen=True)
class Influence:
    """The influence of one variable on one response; a number is None where it is undefined."""

    variable: str
    coefficient: float | None = None  # of the regression on standardised variables
    coefficient_interval: Interval | None = None
    # share of the variance in linear regression, averaged over all orders (LMG); None above 10 variables
    contribution: float | None = None
    contribution_interval: Interval | None = None
    inflation: float | None = None  # of the variance; None if the other variables determine this one
    spearman: float | None = None  # rank correlation
    spearman_interval: Interval | None = None
    rank_coefficient: float | None = None  # of the regression of standardised ranks
    first_order: float | None = None  # Sobol' index
    first_order_interval: Interval | None = None  # includes what the estimator may have missed
    estimator: str | None = None  # "polynomial", or "ranks" where the polynomial misses a structure, such as a jump
    carriers: float | None = None  # samples that carry the first-order index; if few, the interval is too narrow
    # Sobol' index with all interactions; None without a design. Measured scatter is subtracted.
    total: float | None = None
    total_interval: Interval | None = None
    interactions: float | None = None  # total-order minus first-order index, both from the design
    interactions_interval: Interval | None = None
    shapley: float | None = None  # effect; None for independent variables
    shapley_interval: Interval | None = None  # includes what the regression does not explain
    # Effect of the variable with all others fixed, as a share of the variance; above 1 if the others compensate it;
    # None for independent variables.
    own: float | None = None
    own_interval: Interval | None = None
    # of an "only correlated" variable: the acting ones it is correlated with, strongest first
    through: tuple[str, ...] = ()
    # Smallest and largest conditional expectation of the response for values of the variable from its 5th to its 95th
    # percentile, in the unit of the response: the bar of a tornado chart.
    low: float | None = None
    high: float | None = None
    swing_interval: Interval | None = None  # of ``high - low``
    curve: tuple[tuple[float, float], ...] = ()  # (variable, expected response) from the 5th to the 95th percentile
    # the linear coefficient or a Sobol' index differs from 0 (Bonferroni over the variables)
    significant: bool | None = None
    verdict: str = OPEN  # "critical", "not critical", "only correlated" or "open"

    @property
    def share(self) -> float | None:
        """Share of the variance: Shapley effect or total-order index if known, else the first-order index."""
        known = [share for share in (self.shapley, self.total) if share is not None]
        return known[0] if known else self.first_order


@dataclass(frozen=True)
class ResponseSensitivity:
    """The sensitivity of one response to the variables."""

    response: str
    n: int  # samples with a value; regressions and indices use at most 200,000 of them, drawn at random
    independent: bool | None  # no correlation is requested or beyond chance; otherwise first-order indices overlap
    degree: int | None  # of the polynomials used for the first-order indices
    r2: float | None  # share of the variance explained by linear regression (adjusted)
    r2_rank: float | None  # by the regression of ranks
    # share of the variance that is not a sum of functions of single variables, scatter included
    interaction: float | None
    interaction_interval: Interval | None
    influences: tuple[Influence, ...]  # one per variable, in the order of the variables
    # "critical" if a variable is; "not critical" if none is and less than a tenth of the variance remains for
    # interactions that total-order indices do not cover; else "open".
    verdict: str
    rejects: RejectCauses | None
    worst: tuple[WorstSample, ...]
    notes: tuple[str, ...]  # why numbers are None, and cautions
    attribution: RejectAttribution | None = None  # parts of the reject share by variable; None without a reject
    # Part of `interaction` that is scatter between runs of the same sample with different steps, which no input causes;
    # None if no repeat measures it.
    scatter: float | None = None
    scatter_interval: Interval | None = None
    # `interaction` without the scatter: interactions, and jumps; None if scatter is not measured
    rest: float | None = None
    rest_interval: Interval | None = None

    @property
    def ranked(self) -> tuple[Influence, ...]:
        """The influences in decreasing order of their shares."""
        return tuple(sorted(self.influences, key=lambda i: -(i.share or 0.0)))


@dataclass(frozen=True)
class Sensitivity:
    """The sensitivity of all responses to all variables."""

    variables: tuple[str, ...]
    responses: tuple[ResponseSensitivity, ...]

    def never_critical(self) -> tuple[str, ...]:
        """Return the variables that are "not critical" or "only correlated" for every response."""
        verdicts = {v: {r.influences[i].verdict for r in self.responses} for i, v in enumerate(self.variables)}
        return tuple(name for name, seen in verdicts.items() if seen and seen <= {NOT_CRITICAL, CORRELATED})


def influence_of(variable: str, at: int, measures: Measures, interaction: float, confidence: float) -> Influence:
    """Return the influence of one variable on the response at position `at` of the measures."""
    # `interaction` is the largest possible share of the variance due to interactions.
    if variable not in measures.variables:
        return Influence(variable, verdict=NOT_CRITICAL)
    i, quantile = measures.variables[variable], jackknife_quantile(measures.groups, confidence)
    line, ranks, alone, std = measures.linear, measures.rank, measures.effects, float(measures.std[at])
    coefficient, error = float(line.coefficient[at, i]), float(line.coefficient_error[at, i])
    share, share_error = float(alone.share[at, i]), float(alone.share_error[at, i])
    contribution = None if line.contribution is None else float(line.contribution[at, i])
    contribution_error = 0.0 if line.contribution_error is None else float(line.contribution_error[at, i])
    # Without the one group of rows in which the variable differs, there is no coefficient.
    ends = coefficient - quantile * error, coefficient + quantile * error
    contribution_ends = None
    if contribution is not None and math.isfinite(contribution_error):
        contribution_ends = share_interval(contribution, quantile * contribution_error)
    curve = measures.mean[at] + std * alone.curve[at, i]
    swing, swing_half = float(np.ptp(curve)), quantile * std * float(alone.swing_error[at, i])
    errors_needed = needed_errors(len(measures.variables), confidence, measures.groups)
    linear_effect = abs(coefficient) > errors_needed * error and coefficient**2 > NEGLIGIBLE_SHARE
    significant = linear_effect or share > max(errors_needed * share_error, NEGLIGIBLE_SHARE)
    low, high = share_interval(share, quantile * share_error)
    interval = low, as_share(high + float(alone.missed[at, i]))
    return Influence(
        variable=variable,
        coefficient=coefficient,
        coefficient_interval=ends if math.isfinite(error) else None,
        contribution=contribution,
        contribution_interval=contribution_ends,
        inflation=float(line.inflation[i]) if np.isfinite(line.inflation[i]) else None,
        spearman=float(ranks.spearman[at, i]),
        spearman_interval=(float(ranks.spearman_low[at, i]), float(ranks.spearman_high[at, i])),
        rank_coefficient=float(ranks.coefficient[at, i]),
        first_order=as_share(share),
        first_order_interval=interval,
        estimator=RANKS if alone.by_ranks[at, i] else POLYNOMIAL,
        carriers=float(alone.carriers[at, i]),
        low=float(curve.min()),
        high=float(curve.max()),
        swing_interval=(max(swing - swing_half, 0.0), swing + swing_half),
        curve=tuple(zip(alone.curve_x[i].tolist(), curve.tolist(), strict=True)),
        significant=bool(significant),
        verdict=_word(interval, interaction, significant=bool(significant)),
    )


def with_total_order(influence: Influence, totals: TotalOrder, confidence: float) -> Influence:
    """Return an influence with its total-order index added, which then decides the verdict."""
    if influence.first_order is None or influence.variable not in totals.variables:
        return influence
    i, quantile = totals.variables.index(influence.variable), jackknife_quantile(GROUPS, confidence)
    total, error = float(totals.total[i]), float(totals.total_error[i])
    interactions, half = float(totals.interactions[i]), quantile * float(totals.interactions_error[i])
    errors_needed = needed_errors(len(totals.variables), confidence)
    significant = bool(influence.significant) or total > max(errors_needed * error, NEGLIGIBLE_SHARE)
    interval = share_interval(total, quantile * error)
    return replace(
        influence,
        total=as_share(total),
        total_interval=interval,
        interactions=as_share(interactions),
        interactions_interval=share_interval(interactions, half),
        significant=significant,
        verdict=_word(interval, 0.0, significant=significant),
    )


def with_total_effect(
    influence: Influence, at: int, measures: Measures, scatter: float, confidence: float
) -> Influence:
    """Return an influence judged by its total effect too, which a regression with products gives where it is needed."""
    # A variable stays critical that is so alone. What the regression leaves, less `scatter`, may belong to any
    # variable.
    found = measures.totals.get(at)
    if found is None or influence.verdict == CRITICAL or influence.variable not in measures.variables:
        return influence
    i, quantile = measures.variables[influence.variable], jackknife_quantile(measures.groups, confidence)
    total, error = float(found.total[0, i]), float(found.total_error[0, i])
    low, high = share_interval(total, quantile * error)
    left = max(float(found.remainder[0]) - scatter, 0.0) + quantile * float(found.remainder_error[0])
    errors_needed = needed_errors(len(measures.variables), confidence, measures.groups)
    significant = bool(influence.significant) or total > max(errors_needed * error, NEGLIGIBLE_SHARE)
    return replace(influence, significant=significant, verdict=_word((low, high + left), 0.0, significant=significant))


def with_shapley(influence: Influence, at: int, measures: Measures, scatter: float, confidence: float) -> Influence:
    """Return the influence of a correlated variable with its Shapley effect added, which then decides the verdict."""
    # The share `scatter` of the variance, a part of what the regression does not explain, belongs to no variable.
    if measures.independent or influence.variable not in measures.variables:
        return influence
    if measures.shapley is None:
        return replace(influence, verdict=OPEN)
    effects, i = measures.shapley, measures.variables[influence.variable]
    quantile = jackknife_quantile(measures.groups, confidence)
    errors_needed = needed_errors(len(measures.variables), confidence, measures.groups)
    share, half = float(effects.share[at, i]), quantile * float(effects.share_error[at, i])
    own, own_half = float(effects.own[at, i]), quantile * float(effects.own_error[at, i])
    left = max(float(effects.remainder[at]) - scatter, 0.0)
    most_left = left + quantile * float(effects.remainder_error[at])
    low, high = share_interval(share, half)
    # What the regression leaves unexplained may belong to this variable, all of it.
    interval = low, as_share(high + left)
    significant = share > max(errors_needed * float(effects.share_error[at, i]), NEGLIGIBLE_SHARE)
    word = _word(interval, most_left, significant=significant)
    if word == CRITICAL and own - own_half < OWN_EFFECT:
        word = CORRELATED if own + own_half < OWN_EFFECT else OPEN
    return replace(
        influence,
        shapley=as_share(share),
        shapley_interval=interval,
        own=max(own, 0.0),
        own_interval=(max(own - own_half, 0.0), max(own + own_half, 0.0)),
        through=_acting(influence.variable, at, measures, quantile) if word == CORRELATED else (),
        significant=significant,
        verdict=word,
    )


def _acting(variable: str, at: int, measures: Measures, quantile: float) -> tuple[str, ...]:
    """Return the variables that act themselves and are correlated with this one beyond chance, the strongest first."""
    effects, i = measures.shapley, measures.variables[variable]
    if effects is None:
        return ()
    closeness = np.abs(measures.linear.correlation[i])
    acting = effects.own[at] - quantile * effects.own_error[at] >= OWN_EFFECT
    close = {v: closeness[j] for v, j in measures.variables.items() if v != variable and acting[j]}
    largest = max(close.values(), default=0.0)
    return tuple(v for v in sorted(close, key=lambda name: -close[name]) if close[v] >= largest / 2)


def needed_errors(variables: int, confidence: float, groups: int = GROUPS) -> float:
    """Return how many standard errors an effect must differ from 0 (Bonferroni over the variables)."""
    # Two two-sided tests for each variable.
    return jackknife_quantile(groups, 1 - (1 - confidence) / (2 * variables))


def _word(interval: Interval, interaction: float, *, significant: bool) -> str:
    """Return the verdict on a variable from the interval of its share and the largest share of interactions."""
    if significant and interval[0] >= CRITICAL_SHARE:
        return CRITICAL
    return OPEN if max(interval[1], interaction) >= CRITICAL_SHARE else NOT_CRITICAL


def response_verdict(influences: tuple[Influence, ...], interaction: float) -> str:
    """Return the verdict of a response whose interactions explain at most the share `interaction`."""
    verdicts = {influence.verdict for influence in influences}
    if CRITICAL in verdicts:
        return CRITICAL
    return OPEN if OPEN in verdicts or interaction >= CRITICAL_SHARE else NOT_CRITICAL


def as_share(value: float) -> float:
    """Return an estimate of a share, clipped to 0 and 1."""
    return min(max(value, 0.0), 1.0)


def share_interval(value: float, half: float) -> Interval:
    """Return the interval of a share, clipped to 0 and 1."""
    return as_share(value - half), as_share(value + half)
