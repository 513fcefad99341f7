"""Shapley effects: shares of the variance that correlated variables explain, from the given samples.

First-order indices of correlated variables overlap, and can be hidden by opposite signs: for ``z0 + z1`` with
correlation -0.9 each variable explains almost nothing alone. Shapley effects (Owen 2014; Song, Nelson, Staum 2016)
divide the variance: the worth of a set of variables is the share of the variance that a regression on their polynomials
and products explains (``Var(E[y | x_S]) / Var(y)``). Part of a variable's share may be due only to its correlation with
another variable. This is shown by its *own effect* with all others fixed: the loss of the regression without the
variable, divided by the part of the variable that the others do not determine. For a weighted sum it is the squared
standardised coefficient.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from reporting.arrays import Array
from reporting.sensitivity.first_order import (
    best_columns,
    jackknife_error,
    least_squares,
    most_degree,
    unexplained_share,
)
from reporting.sensitivity.jumps import MOST_ROWS, cuts
from reporting.sensitivity.polynomials import Sums, group_sums
from reporting.sensitivity.regression import MOST_SHARED
from reporting.sensitivity.shapley import shapley_values

_MOST_DEGREE = 6
_ROWS_PER_COLUMN = 5
_MOST_PLACES = 6  # largest number of jumps along one variable, over all responses


@dataclass(frozen=True)
class ShapleyEffects:
    """Shares of k correlated variables in the variance of m responses."""

    share: Array  # Shapley effect, shape (m, k)
    share_error: Array
    own: Array  # with all other variables fixed, a share, shape (m, k); above 1 if the others compensate it
    own_error: Array
    interaction: Array  # share that is not a sum of functions of single variables, shape (m,)
    interaction_error: Array
    remainder: Array  # share that the regression does not explain, attributed to no variable, shape (m,)
    remainder_error: Array


def shapley_effects(x: Array, y: Array, group: NDArray[np.intp], inflation: Array) -> ShapleyEffects | None:
    """Return the Shapley effects of x, shape (n, k), on y, shape (n, m); None above 10 variables.

    No column is constant, and rows are in random order; `inflation`, shape (k,), is the variance inflation of the
    variables.
    """
    n, k = x.shape
    if k > MOST_SHARED:
        return None
    degree = min(most_degree(n, k), _MOST_DEGREE)
    smooth = _Regression(k, degree)
    sums = smooth.sums(x, y, group)
    places = _jumps(smooth, sums, x[:MOST_ROWS], y[:MOST_ROWS])
    regression = _Regression(k, degree, tuple(places))
    if places:
        sums = regression.sums(x, y, group)
    members, candidates = regression.members(), regression.candidates(n)
    chosen, m, parts = best_columns(sums, candidates), y.shape[1], sums.without_each()
    worth, additive = np.zeros((2**k, parts.rows.size, m)), np.zeros((parts.rows.size, m))
    for choice in np.unique(chosen):
        at, columns = np.flatnonzero(chosen == choice), candidates[choice]
        single = columns[(members[columns] & (members[columns] - 1)) == 0]
        additive[:, at] = unexplained_share(parts, least_squares(parts, single), single)[:, at]
        for subset in range(1, 2**k):
            own = columns[(members[columns] & ~subset) == 0]
            worth[subset][:, at] = 1 - unexplained_share(parts, least_squares(parts, own), own)[:, at]
    share = np.moveaxis(shapley_values(worth), 0, 2)
    last = 2**k - 1
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
class _Regression:
    """Polynomials of each of k variables, products of two, and jumps at places (variable, value)."""

    k: int
    degree: int
    places: tuple[tuple[int, float], ...] = ()

    def sums(self, x: Array, y: Array, group: NDArray[np.intp]) -> Sums:
        """Return the sums of a sample."""
        return group_sums(x, y, self.degree, group, self.more)

    def more(self, x: Array, values: Array) -> Array:
        """Return products and jumps at the rows of x, whose polynomials are `values`."""
        products = [values[:, 1 + i] * values[:, 1 + j] for i, j in self._pairs()]
        jumps = [(x[:, i] > at).astype(np.float64) for i, at in self.places]
        return np.column_stack([np.empty((x.shape[0], 0)), *products, *jumps])

    def members(self) -> NDArray[np.int64]:
        """Return the set of variables, as bits, of each column."""
        polynomials = [1 << i for _ in range(self.degree) for i in range(self.k)]
        return np.array(
            [0, *polynomials, *(1 << i | 1 << j for i, j in self._pairs()), *(1 << i for i, _ in self.places)]
        )

    def candidates(self, n: int) -> list[NDArray[np.intp]]:
        """Return the candidate sets of columns that have at least five of n rows per column."""
        first, pairs = 1 + self.k * self.degree, len(self._pairs())
        products, jumps = first + np.arange(pairs), first + pairs + np.arange(len(self.places))
        nothing = products[:0]
        found = [
            np.concatenate([np.arange(1 + self.k * degree), *more])
            for degree in range(1, self.degree + 1)
            for more in product((nothing, products), (nothing, jumps))
            if more[1] is nothing or degree == self.degree  # without its variable's polynomial a jump does not fit
        ]
        return [columns for columns in found if columns.size * _ROWS_PER_COLUMN <= n or columns.size == 1 + self.k]

    def _pairs(self) -> list[tuple[int, int]]:
        """Return the pairs of variables."""
        return [(i, j) for i in range(self.k) for j in range(i)]


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
