"""The measures of sensitivity of all responses that have their values in the same rows."""

from dataclasses import dataclass

import numpy as np

from reporting.arrays import Array, random_rows
from reporting.capability.moments import ROUNDING
from reporting.sensitivity.first_order import Effects, effects, most_degree
from reporting.sensitivity.polynomials import GROUPS, group_sums
from reporting.sensitivity.regression import Linear, Rank, linear, rank


@dataclass(frozen=True)
class Measures:
    """The measures of m responses to k variables, over the same rows.

    Attributes
    ----------
    variables, responses : dict of str to int
        Position of each varying variable and response in the arrays.
    mean, std : array, shape (m,)
        Of the responses, in their units.
    linear : Linear
    rank : Rank
    effects : Effects
        First-order indices and conditional expectations.
    independent : bool
        The variables show no correlation.
    """

    variables: dict[str, int]
    responses: dict[str, int]
    mean: Array
    std: Array
    linear: Linear
    rank: Rank
    effects: Effects
    independent: bool


def measure(columns: dict[str, Array], values: dict[str, Array], confidence: float) -> Measures | None:
    """Return all measures; None if there are too few rows or nothing varies.

    Parameters
    ----------
    columns, values : dict of str to array, each of shape (n,)
        Variables and responses, finite.
    confidence : float
        Of the intervals of rank correlations.
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
    sums = group_sums(x, y, most_degree(rows.size, len(x_names)))
    regression = linear(sums)
    largest_correlation = np.abs(regression.correlation - np.eye(len(x_names))).max()
    independent = bool(largest_correlation <= 0.02 + 4 / np.sqrt(rows.size))  # 4 standard errors, and no less than 0.02
    ends = np.quantile(x, [0.05, 0.95], axis=0)
    return Measures(
        variables={name: i for i, name in enumerate(x_names)},
        responses={name: i for i, name in enumerate(y_names)},
        mean=y.mean(axis=0),
        std=y.std(axis=0),
        linear=regression,
        rank=rank(x, y, confidence),
        effects=effects(sums, x, y, (ends[0], ends[1]), independent=independent),
        independent=independent,
    )


def fewest_rows(variables: int) -> int:
    """Return the fewest rows for a regression on that many variables: two a group, five a coefficient."""
    return max(2 * GROUPS, 5 * (variables + 1))


def varies(column: Array) -> bool:
    """Return whether a column is more than a constant with rounding errors."""
    if column.size < 2:
        return False
    return float(np.std(column)) > ROUNDING * float(np.abs(column).max())
