"""Shapley effects: shares of the variance that correlated variables explain, from the given samples.

First-order indices of correlated variables overlap, and can be hidden by opposite signs: for ``z0 + z1`` with
correlation -0.9 each variable explains almost nothing alone. Shapley effects (Owen 2014; Song, Nelson, Staum 2016)
divide the variance: the worth of a set of variables is the share of the variance that a regression on their polynomials
and products explains (``Var(E[y | x_S]) / Var(y)``). Part of a variable's share may be due only to its correlation with
another variable. This is shown by its *own effect* with all others fixed: the loss of the regression without the
variable, divided by the part of the variable that the others do not determine. For a weighted sum it is the squared
standardised coefficient.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from reporting.arrays import Array
from reporting.sensitivity.first_order import (
    MOST_ROWS,
    best_columns,
    cuts,
    jackknife_error,
    least_squares,
    most_degree,
    unexplained_share,
)
from reporting.sensitivity.polynomials import Sums, group_sums
from reporting.sensitivity.regression import MOST_SHARED, shapley_values

Orders = tuple[tuple[int, int], ...]
_LINEAR: Orders = ((1, 1),)
_QUADRATIC: Orders = ((1, 1), (1, 2), (2, 1), (2, 2))
_MOST_DEGREE = 6
_ROWS_PER_COLUMN = 5
_MOST_PLACES = 6  # largest number of jumps along one variable, over all responses


@dataclass(frozen=True)
class JointEffects:
    """What a regression on several variables together says of the variance of m responses."""

    interaction: Array  # share that is not a sum of functions of single variables, jumps included, shape (m,)
    interaction_error: Array
    remainder: Array  # share that the regression does not explain, attributed to no variable, shape (m,)
    remainder_error: Array


@dataclass(frozen=True)
class ShapleyEffects(JointEffects):
    """Shares of k correlated variables in the variance of m responses."""

    share: Array  # Shapley effect, shape (m, k)
    share_error: Array
    own: Array  # with all other variables fixed, a share, shape (m, k); above 1 if the others compensate it
    own_error: Array


def shapley_effects(x: Array, y: Array, group: NDArray[np.intp], inflation: Array) -> ShapleyEffects | None:
    """Return the Shapley effects of x, (n, k), on y, (n, m), by the variables' inflation; None above 10 variables."""
    k = x.shape[1]
    if k > MOST_SHARED:
        return None
    last = 2**k - 1
    smooth = _smooth(x, _LINEAR)
    worth, additive = _worths(x, y, group, smooth, smooth.sums(x, y, group), range(1, 2**k))
    share = np.moveaxis(shapley_values(worth), 0, 2)
    lost = np.stack([worth[last] - worth[last ^ 1 << i] for i in range(k)], axis=2) * inflation
    return ShapleyEffects(
        share=share[0],
        share_error=jackknife_error(share),
        own=lost[0],
        own_error=jackknife_error(lost),
        interaction=additive[0],
        interaction_error=jackknife_error(additive),
        remainder=1 - worth[last, 0],
        remainder_error=jackknife_error(worth[last]),
    )


@dataclass(frozen=True)
class TotalEffects(JointEffects):
    """What k independent variables explain with their interactions in pairs, in the variance of m responses."""

    total: Array  # loss of the regression without the variable, a share, shape (m, k)
    total_error: Array


def total_effects(x: Array, y: Array, group: NDArray[np.intp]) -> list[TotalEffects]:
    """Return what independent x, (n, k), explain in each response of y, (n, m); empty above 10 variables."""
    k = x.shape[1]
    if k > MOST_SHARED or not y.shape[1]:
        return []
    last, found = 2**k - 1, []
    without = [last ^ 1 << i for i in range(k)]
    smooth = _smooth(x, _QUADRATIC)
    sums = smooth.sums(x, y, group)  # one pass over the variables for all responses; each has jumps of its own
    for r in range(y.shape[1]):
        worth, additive = _worths(x, y[:, [r]], group, smooth, sums.only(r), [last, *without])
        total = np.stack([worth[last] - worth[subset] for subset in without], axis=2)
        found.append(
            TotalEffects(
                total=total[0],
                total_error=jackknife_error(total),
                interaction=additive[0],
                interaction_error=jackknife_error(additive),
                remainder=1 - worth[last, 0],
                remainder_error=jackknife_error(worth[last]),
            )
        )
    return found


def _smooth(x: Array, orders: Orders) -> "_Regression":
    """Return the regression without jumps."""
    n, k = x.shape
    return _Regression(k, min(most_degree(n, k), _MOST_DEGREE), orders)


def _worths(
    x: Array, y: Array, group: NDArray[np.intp], smooth: "_Regression", sums: Sums, subsets: Iterable[int]
) -> tuple[Array, Array]:
    """Return the share that each of some sets of variables explains, and what no sum of single variables does."""
    # The shapes are (2^k, 1 + g, m), 0 for other sets, and (1 + g, m): of all rows, and of those without each group.
    # `sums` are those of the smooth regression.
    n, k = x.shape
    places = _jumps(smooth, sums, x[:MOST_ROWS], y[:MOST_ROWS])
    regression = replace(smooth, places=tuple(places))
    if places:
        sums = regression.sums(x, y, group)
    members, candidates = regression.members(), regression.candidates(n)
    chosen, m, parts = best_columns(sums, candidates), y.shape[1], sums.without_each()
    worth, additive = np.zeros((2**k, parts.rows.size, m)), np.zeros((parts.rows.size, m))
    for choice in np.unique(chosen):
        at, columns = np.flatnonzero(chosen == choice), candidates[choice]
        single = columns[(members[columns] & (members[columns] - 1)) == 0]
        additive[:, at] = unexplained_share(sums, parts, least_squares(parts, single), single)[:, at]
        for subset in subsets:
            own = columns[(members[columns] & ~subset) == 0]
            worth[subset][:, at] = 1 - unexplained_share(sums, parts, least_squares(parts, own), own)[:, at]
    return worth, additive


@dataclass(frozen=True)
class _Regression:
    """Polynomials of k variables, products of two of given orders (degrees), and jumps at places (variable, value)."""

    k: int
    degree: int
    orders: Orders
    places: tuple[tuple[int, float], ...] = ()

    def sums(self, x: Array, y: Array, group: NDArray[np.intp]) -> Sums:
        """Return the sums of a sample."""
        return group_sums(x, y, self.degree, group, self.more)

    def more(self, x: Array, values: Array) -> Array:
        """Return products and jumps at the rows of x, whose polynomials are `values`."""
        at = [(1 + i + self.k * (p - 1), 1 + j + self.k * (q - 1)) for i, j, p, q in self._products()]
        products = [values[:, i] * values[:, j] for i, j in at]
        jumps = [(x[:, i] > at).astype(np.float64) for i, at in self.places]
        return np.array([*products, *jumps]).reshape(-1, x.shape[0]).T

    def members(self) -> NDArray[np.int64]:
        """Return the set of variables, as bits, of each column."""
        polynomials = [1 << i for _ in range(self.degree) for i in range(self.k)]
        return np.array(
            [0, *polynomials, *(1 << i | 1 << j for i, j, *_ in self._products()), *(1 << i for i, _ in self.places)]
        )

    def candidates(self, n: int) -> list[NDArray[np.intp]]:
        """Return the candidate sets of columns that have at least five of n rows per column."""
        first, pairs = 1 + self.k * self.degree, len(self._products())
        products, jumps = first + np.arange(pairs), first + pairs + np.arange(len(self.places))
        nothing, linear = products[:0], products[: self.k * (self.k - 1) // 2]
        found = [
            np.concatenate([np.arange(1 + self.k * degree), *more])
            for degree in range(1, self.degree + 1)
            for more in product(
                (nothing, linear, products) if pairs > linear.size else (nothing, linear), (nothing, jumps)
            )
            if more[1] is nothing or degree == self.degree  # without its variable's polynomial a jump does not fit
        ]
        return [columns for columns in found if columns.size * _ROWS_PER_COLUMN <= n or columns.size == 1 + self.k]

    def _products(self) -> list[tuple[int, int, int, int]]:
        """Return the pairs of variables with the degrees of their polynomials, those of degree 1 first."""
        orders = [(p, q) for p, q in self.orders if max(p, q) <= self.degree]
        return [(i, j, p, q) for p, q in orders for i in range(self.k) for j in range(i)]


def _jumps(smooth: _Regression, sums: Sums, x: Array, y: Array) -> list[tuple[int, float]]:
    """Return the places where the residuals of smooth regressions jump most clearly, for each variable."""
    candidates = smooth.candidates(int(sums.rows.sum()))
    polynomials = sums.basis(x)
    values = np.hstack([polynomials, smooth.more(x, polynomials)])
    z = (y - y.mean(axis=0)) / y.std(axis=0)
    total = sums.without_each()
    places: dict[int, list[tuple[float, float]]] = {i: [] for i in range(smooth.k)}
    for r, choice in enumerate(best_columns(sums, candidates)):
        columns = candidates[choice]
        residual = z[:, r] - values[:, columns] @ least_squares(total, columns)[0, :, r]
        for i, found in places.items():
            found += cuts(x[:, i], residual)
    clearest = {i: sorted(found, key=lambda place: -place[1])[:_MOST_PLACES] for i, found in places.items()}
    return [(i, at) for i, found in clearest.items() for at, _ in found]
