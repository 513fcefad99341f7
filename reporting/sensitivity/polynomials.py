"""Sums over a sample, computed in one pass, for all regressions of the report.

Each variable has a basis of polynomials that are orthonormal over its own sample (Stieltjes' procedure, Gautschi 2004,
section 2.2): units and origins have no effect, and the normal equations are well conditioned at any degree used here.
Products are summed over groups of rows. The sums without one group give both the error of prediction on that group
and the delete-a-group jackknife. Rows must be in random order: every 20th sample of a Sobol' sequence or of a grid
does not represent the whole. Rows of a production lot share a shift, so each lot is entirely in one group.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from reporting.arrays import Array

GROUPS = 20
_CHUNK = 50_000  # rows whose basis is in memory at the same time
_RECURRENCE_ROWS = 20_000  # a nearly orthonormal basis is enough: the sums contain its exact products
# Below this norm a polynomial vanishes on the sample: the variable has no further distinct values.
_VANISHES = 1e-7


@dataclass(frozen=True)
class Basis:
    """Polynomials of k variables up to a degree, in the order constant, all of degree 1, all of degree 2, ..."""

    mean: Array  # of the sample, in the variables' units, shape (k,)
    std: Array  # like `mean`
    center: Array  # shape (degree, k): ``norm[j] p[j+1] = (t - center[j]) p[j] - norm[j-1] p[j-1]``, t standardised
    norm: Array  # shape (degree, k); the basis of a variable ends at a norm of 0

    @property
    def degree(self) -> int:
        """Highest degree."""
        return int(self.center.shape[0])

    def columns(self, variable: int, degree: int) -> NDArray[np.intp]:
        """Return the columns of the polynomials of a variable up to a degree, without the constant."""
        return 1 + variable + self.mean.size * np.arange(degree)

    def __call__(self, x: Array) -> Array:
        """Return the basis at points of shape (n, k) as an array of shape (n, 1 + k degree)."""
        # Columns lie one after the other in memory: what is computed of each then runs along it.
        t = np.ascontiguousarray(x.T)
        t = (t - self.mean[:, None]) / self.std[:, None]
        before, at, below = np.zeros_like(t), np.ones_like(t), np.zeros((t.shape[0], 1))
        blocks = [np.ones((1, t.shape[1]))]
        for center, norm in zip(self.center[:, :, None], self.norm[:, :, None], strict=True):
            before, at = at, _over((t - center) * at - below * before, norm)
            below = norm
            blocks.append(at)
        return np.concatenate(blocks).T


@dataclass(frozen=True)
class Sums:
    """Products of the p basis functions and the m standardised responses, summed over each of g groups of rows."""

    basis: Basis
    rows: Array  # of each group, shape (g,)
    bb: Array  # shape (g, p, p)
    by: Array  # shape (g, p, m)
    yy: Array  # shape (g, m)

    def only(self, response: int) -> "Sums":
        """Return the sums with one of the responses."""
        one = slice(response, response + 1)
        return Sums(self.basis, self.rows, self.bb, self.by[:, :, one], self.yy[:, one])

    def without_each(self) -> "Sums":
        """Return the sums over all rows, then over all rows except those of each group, shape (1 + g, ...)."""
        return Sums(self.basis, *(total_and_rest(a) for a in (self.rows, self.bb, self.by, self.yy)))


def basis_of(x: Array, degree: int) -> Basis:
    """Return the orthonormal polynomials of each column of x, shape (n, k), no column constant."""
    mean, std = x.mean(axis=0), x.std(axis=0)
    t = (x[:: max(1, x.shape[0] // _RECURRENCE_ROWS)] - mean) / std
    center, norm = np.zeros((degree, t.shape[1])), np.zeros((degree, t.shape[1]))
    before, at, below = np.zeros_like(t), np.ones_like(t), np.zeros(t.shape[1])
    for j in range(degree):
        center[j] = np.mean(t * at * at, axis=0)
        following = (t - center[j]) * at - below * before
        size = np.sqrt(np.mean(following**2, axis=0))
        norm[j] = np.where(size > _VANISHES, size, 0.0)
        before, at = at, _over(following, norm[j])
        below = norm[j]
    return Basis(mean, std, center, norm)


def groups_of(n: int, lots: NDArray[np.generic] | None = None) -> NDArray[np.intp]:
    """Return the group of each of n rows: 20 groups, or one per lot if there are fewer lots."""
    of_rows = np.arange(n) if lots is None else np.unique(lots, return_inverse=True)[1]
    return np.asarray(of_rows % GROUPS, np.intp)


def group_sums(
    x: Array,
    y: Array,
    degree: int,
    group: NDArray[np.intp] | None = None,
    more: Callable[[Array, Array], Array] | None = None,
) -> Sums:
    """Return the sums of finite variables x, shape (n, k), and responses y, shape (n, m), no column constant."""
    # Rows are in random order (`reporting.arrays.random_rows`); by default row i belongs to group ``i % 20``. `more`
    # (rows of x, their basis) gives further functions of the variables, shape (rows, q), after the polynomials.
    basis, group = basis_of(x, degree), groups_of(x.shape[0]) if group is None else group
    groups = int(group.max()) + 1
    y_mean, y_std = y.mean(axis=0), y.std(axis=0)
    p, m = 1 + degree * x.shape[1] + (0 if more is None else more(x[:1], basis(x[:1])).shape[1]), y.shape[1]
    rows, bb, by, yy = np.zeros(groups), np.zeros((groups, p, p)), np.zeros((groups, p, m)), np.zeros((groups, m))
    for g in range(groups):
        members = np.flatnonzero(group == g)
        for first in range(0, members.size, _CHUNK):
            part = members[first : first + _CHUNK]
            values, z = basis(x[part]), (y[part] - y_mean) / y_std
            if more is not None:
                values = np.hstack([values, more(x[part], values)])
            rows[g] += z.shape[0]
            bb[g] += values.T @ values
            by[g] += values.T @ z
            yy[g] += np.sum(z * z, axis=0)
    return Sums(basis, rows, bb, by, yy)


def _over(values: Array, norm: Array) -> Array:
    """Return values / norm; zero where the basis of a variable ends."""
    return values * np.where(norm > 0, 1.0 / np.where(norm > 0, norm, 1.0), 0.0)


def total_and_rest(groups: Array) -> Array:
    """Return the total over the first axis, followed by the total without each entry; shape (1 + g, ...)."""
    total = groups.sum(axis=0)
    return np.concatenate([total[None], total[None] - groups])
