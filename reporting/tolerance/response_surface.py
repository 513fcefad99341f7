"""A response as a polynomial of the variables, for changes too large for reweighting the samples.

The model moves the samples: if the variables x of a sample become x', its response becomes ``y + g(x') - g(x)`` with
the least-squares polynomial g. A change of one marginal distribution that keeps the ranks also keeps the copula, so the
correlation of variables is unchanged. The residual of g stays with its sample.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from reporting.arrays import Array
from reporting.capability.intervals import Interval
from reporting.tolerance.weighted_intervals import LotLabels, by_lot, mean_interval

# A model that leaves more of the variance unexplained is not used.
MOST_UNEXPLAINED = 0.03
# With a larger share of samples moved beyond the range of the campaign, the result would be an extrapolation.
MOST_BEYOND = 0.01
_ROWS_PER_TERM = 10
_MOST_TERMS = 150
_LEAST_VALUES = 50


@dataclass(frozen=True)
class Surface:
    """A polynomial of the standardised variables, fitted to one response."""

    y: Array  # response at the fitted samples, shape (n,)
    x: Array  # standardised variables there, shape (n, k)
    terms: Array  # 1, the variables, and their squares and products if `quadratic`, shape (n, terms)
    coefficients: Array  # shape (terms,)
    inverse: Array  # of the normal matrix, shape (terms, terms)
    residual: Array  # ``y - g(x)``, shape (n,)
    quadratic: bool
    unexplained: float  # share of the variance, adjusted for the number of terms

    def moved(self, to: Mapping[int, Array]) -> tuple[NDArray[np.intp], Array]:
        """Return which terms change if some standardised variables have other values, and by how much.

        The change has shape (n, changed terms).
        """
        x = self.x.copy()
        x[:, list(to)] = np.column_stack(list(to.values()))
        columns = 1 + np.array(list(to), np.intp)
        by = x[:, columns - 1] - self.x[:, columns - 1]
        if not self.quadratic:
            return columns, by
        i, j = np.triu_indices(x.shape[1])
        changed = np.flatnonzero(np.isin(i, list(to)) | np.isin(j, list(to)))
        i, j = i[changed], j[changed]
        products = x[:, i] * x[:, j] - self.x[:, i] * self.x[:, j]
        return np.concatenate([columns, 1 + x.shape[1] + changed]), np.column_stack([by, products])


def fit_surface(y: Array, variables: Mapping[str, Array]) -> Surface | None:
    """Return the polynomial of one response; None with too few values or too large an unexplained share.

    The values, shape (n,), are finite and not all equal, and the variables vary.
    """
    x = np.column_stack([(column - column.mean()) / column.std() for column in variables.values()])
    n, k = x.shape
    full = (k + 1) * (k + 2) // 2
    quadratic = full <= min(_MOST_TERMS, n // _ROWS_PER_TERM)
    count = full if quadratic else k + 1
    if n < max(_LEAST_VALUES, _ROWS_PER_TERM * count):
        return None
    terms = _terms(x, quadratic)
    inverse = np.asarray(np.linalg.pinv(terms.T @ terms, hermitian=True), np.float64)
    coefficients = inverse @ (terms.T @ (y - y.mean()))
    residual = y - y.mean() - terms @ coefficients
    unexplained = float(np.sum(residual**2)) / (n - count) / float(np.var(y, ddof=1))
    if unexplained > MOST_UNEXPLAINED:
        return None
    return Surface(y, x, terms, coefficients, inverse, residual, quadratic, unexplained)


def moved_cpk(
    surface: Surface,
    change: tuple[Mapping[int, Array], float],
    limits: tuple[float | None, float | None],
    confidence: float,
    lots: LotLabels | None,
) -> tuple[float, Interval] | None:
    """Return Cpk with some variables moved, and its interval; None without spread.

    The interval allows for the errors of the samples and of the coefficients; its lower end also allows for a residual
    that grows with the variables. `change` has the new standardised values, shape (n,), by index of the variable, and
    the factor on their standard deviations. At least one limit is needed.
    """
    to, factor = change
    columns, difference = surface.moved(to)
    # sums without a matrix product: with so few columns its threads would cost more than they save
    y = surface.y + np.einsum("ij,j->i", difference, surface.coefficients[columns])
    n, mean, std = y.size, float(y.mean()), float(y.std(ddof=1))
    if not std > 0:
        return None
    deviation = y - mean
    sides = [
        (sign * (mean - limit) / (3 * std), sign)
        for limit, sign in zip(limits, (1, -1), strict=True)
        if limit is not None
    ]
    index, sign = min(sides)
    slope = (sign / (3 * std) - index * deviation / std**2) / n  # derivative of the index with respect to each value
    own = (sign * deviation / 3 - index * (deviation**2 - std**2) / (2 * std)) / std / n
    by_coefficient = surface.inverse[:, columns] @ np.einsum("ij,i->j", difference, slope)
    of_coefficients = np.einsum("ij,j->i", surface.terms, by_coefficient) * surface.residual
    low, high = mean_interval(index, by_lot(own + of_coefficients, lots), confidence)
    # A larger sigma moves an index towards 0: it would raise a lower end that is below 0.
    grown = max(factor**2 - 1, 0.0) * surface.unexplained * float(np.var(surface.y, ddof=1))
    return float(index), (low / math.sqrt(1 + grown / std**2) if low > 0 else low, high)


def beyond(x: Array, to: Array) -> float:
    """Return the share of values moved beyond the range of the samples."""
    return float(np.mean((to < x.min()) | (to > x.max())))


def _terms(x: Array, quadratic: bool) -> Array:
    """Return the terms of the polynomial at standardised variables, shape (n, terms)."""
    first = np.column_stack([np.ones(x.shape[0]), x])
    if not quadratic:
        return first
    i, j = np.triu_indices(x.shape[1])
    return np.column_stack([first, x[:, i] * x[:, j]])
