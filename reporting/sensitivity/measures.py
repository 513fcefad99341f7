"""The measures of sensitivity of all responses with values in the same rows."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from reporting.arrays import Array, random_rows
from reporting.capability.lots import LEAST_LOTS
from reporting.capability.moments import ROUNDING
from reporting.sensitivity.first_order import Effects, effects, jackknife_quantile, most_degree
from reporting.sensitivity.polynomials import GROUPS, group_sums, groups_of
from reporting.sensitivity.regression import Linear, Rank, linear, rank
from reporting.sensitivity.shapley_effects import ShapleyEffects, TotalEffects, shapley_effects, total_effects

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
    columns: dict[str, Array],
    values: dict[str, Array],
    confidence: float,
    correlations: Sequence[tuple[str, str, float]] | None = None,
    lots: NDArray[np.generic] | None = None,
) -> Measures | None:
    """Return all measures of finite columns, shape (n,); None if there are too few rows or nothing varies.

    `correlations` are the requested ones; if not given, the samples decide. The shifts of `lots` correlate variables by
    chance; with `LEAST_LOTS` lots or more, errors are estimated by leaving out whole lots.
    """
    x_names = [name for name, column in columns.items() if varies(column)]
    y_names = [name for name, column in values.items() if varies(column)]
    if not x_names or not y_names:
        return None
    n = next(iter(values.values())).size
    if n < fewest_rows(len(x_names)):
        return None
    rows = random_rows(n)
    x = np.column_stack([columns[name][rows] for name in x_names])
    y = np.column_stack([values[name][rows] for name in y_names])
    count = rows.size if lots is None else np.unique(lots[rows]).size
    group = groups_of(rows.size, None if lots is None or count < LEAST_LOTS else lots[rows])
    sums = group_sums(x, y, most_degree(rows.size, len(x_names)), group)
    regression = linear(sums)
    independent = _independent(regression.correlation, x_names, correlations, count)
    ends = np.quantile(x, [0.05, 0.95], axis=0)
    alone = effects(sums, x, y, group, (ends[0], ends[1]), independent=independent)
    half = jackknife_quantile(sums.rows.size, confidence) * alone.unexplained_error
    asked = (alone.unexplained > half) | (alone.unexplained + half >= CRITICAL_SHARE)
    totals = {int(r): total_effects(x, y[:, [r]], group) for r in np.flatnonzero(asked)} if independent else {}
    return Measures(
        variables={name: i for i, name in enumerate(x_names)},
        responses={name: i for i, name in enumerate(y_names)},
        mean=y.mean(axis=0),
        std=y.std(axis=0),
        linear=regression,
        rank=rank(x, y, confidence),
        effects=alone,
        groups=sums.rows.size,
        independent=independent,
        shapley=None if independent else shapley_effects(x, y, group, regression.inflation),
        totals={r: found for r, found in totals.items() if found is not None},
    )


def _independent(
    found: Array, names: list[str], requested: Sequence[tuple[str, str, float]] | None, independent_rows: int
) -> bool:
    """Return whether the variables are independent: no correlation is requested, and the samples do not show one.

    Chance alone must not make variables count as correlated: 5 standard errors are needed to contradict a request, and
    a p-value of 1 % over all pairs if the request is unknown.
    """
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


def varies(column: Array) -> bool:
    """Return whether a column varies by more than rounding errors."""
    if column.size < 2:
        return False
    return float(np.std(column)) > ROUNDING * float(np.abs(column).max())
