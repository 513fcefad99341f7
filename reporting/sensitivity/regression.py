"""Linear and rank regression of responses on variables, and each variable's contribution to the variance.

- Standardised coefficient: change of the response, in its standard deviations, per standard deviation of the variable.
- Contribution (LMG: Lindeman, Merenda, Gold 1980; the Shapley value of R^2): increase of R^2 by a variable, averaged
  over all orders of variables. Contributions sum to R^2; of independent variables they are the squared coefficients.
- Variance inflation: 1 / (1 - R^2 of the variable on the others).
- Spearman's rank correlation with the interval of Bonett and Wright (2000), and the regression of ranks.

The Shapley value: the division of a total among players who achieve it together (Shapley 1953).

A player's share is what it adds to the worth of the players before it, averaged over all orders in which the players
can enter. The worth of a subset of variables is, for example, the share of a response's variance that its variables
explain; what two variables explain only together is then split between them (Owen 2014). The definition also holds for
correlated variables (Song, Nelson, Staum 2016).
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from reporting.arrays import Array, centred_ranks
from reporting.sensitivity.first_order import jackknife_error
from reporting.sensitivity.polynomials import Sums

MOST_SHARED = 10  # variables; all 2^10 subsets are fitted
# Below this unexplained share of its variance a variable is a linear combination of the others.
_COLLINEAR = 1e-10
_RIDGE = 1e-12  # added to correlation matrices, because collinear variables make them singular


@dataclass(frozen=True)
class Linear:
    """Linear regression of m responses on k standardised variables."""

    coefficient: Array  # standardised, shape (m, k)
    coefficient_error: Array  # standard error (delete-a-group jackknife)
    r2: Array  # explained share of the variance, adjusted for the number of variables, shape (m,)
    contribution: Array | None  # share of the variance by variable, shape (m, k); None above 10 variables
    contribution_error: Array | None
    inflation: Array  # of the variance, shape (k,); infinite if the others determine the variable
    correlation: Array  # between the variables (Pearson), shape (k, k)


def linear(sums: Sums) -> Linear:
    """Return the linear regression from the sums over groups of rows."""
    parts = sums.without_each()
    k = sums.basis.mean.size
    among, with_response = _correlations(parts, k)
    coefficient = _solve(among, with_response)
    explained = np.sum(coefficient[0] * with_response[0], axis=0)
    n = parts.rows[0]
    contribution = shapley_of_r2(among, with_response) if k <= MOST_SHARED else None
    return Linear(
        coefficient=coefficient[0].T,
        coefficient_error=jackknife_error(coefficient).T,
        r2=1 - (1 - explained) * (n - 1) / max(n - k - 1, 1),
        contribution=None if contribution is None else contribution[0].T,
        contribution_error=None if contribution is None else jackknife_error(contribution).T,
        inflation=_inflation(among[0]),
        correlation=among[0],
    )


def shapley_of_r2(among: Array, with_response: Array) -> Array:
    """Return each variable's contribution to R^2, averaged over all orders of variables, shape (g, k, m)."""
    g, k, m = with_response.shape
    r2 = np.zeros((2**k, g, m))
    for subset in range(1, 2**k):
        members = np.flatnonzero([subset >> i & 1 for i in range(k)])
        r = with_response[:, members]
        r2[subset] = np.sum(r * _solve(among[:, members[:, None], members], r), axis=1)
    return np.moveaxis(shapley_values(r2), 0, 1)


@dataclass(frozen=True)
class Rank:
    """Rank correlation and rank regression of m responses and k variables."""

    spearman: Array  # rank correlation, shape (m, k)
    spearman_low: Array  # ends of its interval, shape (m, k)
    spearman_high: Array
    coefficient: Array  # of the regression of standardised ranks, shape (m, k)
    r2: Array  # explained share of the variance of ranks, shape (m,): near 1 for a monotone response


def rank(x: Array, y: Array, confidence: float) -> Rank:
    """Return the rank regression of the columns of y, shape (n, m), on the columns of x, shape (n, k)."""
    k = x.shape[1]
    ranks = [centred_ranks(column) for column in (*x.T, *y.T)]
    columns = [r / max(float(np.sqrt(np.mean(r**2))), np.finfo(float).tiny) for r in ranks]
    n = y.shape[0]
    correlation = np.array([[np.dot(a, b) / n for b in columns] for a in columns[:k]])
    among, spearman = correlation[:, :k], np.clip(correlation[:, k:].T, -1.0, 1.0)
    coefficient = _solve(among, spearman.T).T
    half = float(ndtri(0.5 + confidence / 2)) * np.sqrt((1 + spearman**2 / 2) / max(n - 3, 1))
    z = np.arctanh(np.clip(spearman, -1 + 1e-15, 1 - 1e-15))
    return Rank(
        spearman=spearman,
        spearman_low=np.tanh(z - half),
        spearman_high=np.tanh(z + half),
        coefficient=coefficient,
        r2=np.clip(np.sum(coefficient * spearman, axis=1), 0.0, 1.0),
    )


def _solve(correlation: Array, right: Array) -> Array:
    """Return the coefficients of a regression on standardised variables, which may be collinear."""
    return np.asarray(np.linalg.solve(correlation + _RIDGE * np.eye(correlation.shape[-1]), right))


def _correlations(parts: Sums, k: int) -> tuple[Array, Array]:
    """Return the correlations between variables (g, k, k), and of variables with responses (g, k, m)."""
    n = parts.rows[:, None]
    first = slice(1, 1 + k)  # polynomials of degree 1: the variables, shifted and scaled
    mean_x, mean_y = parts.bb[:, 0, first] / n, parts.by[:, 0] / n
    xx = parts.bb[:, first, first] / n[:, None] - mean_x[:, :, None] * mean_x[:, None, :]
    xy = parts.by[:, first] / n[:, None] - mean_x[:, :, None] * mean_y[:, None, :]
    size_x = np.sqrt(np.einsum("gii->gi", xx))
    size_y = np.sqrt(parts.yy / n - mean_y**2)
    return xx / (size_x[:, :, None] * size_x[:, None, :]), xy / (size_x[:, :, None] * size_y[:, None, :])


def _inflation(among: Array) -> Array:
    """Return the variance inflation of each variable; infinite if the others determine it."""
    k = among.shape[0]
    inflation = np.ones(k)
    for i in range(k):
        others = np.delete(np.arange(k), i)
        r = among[i, others]
        left = 1 - r @ _solve(among[np.ix_(others, others)], r[:, None])[:, 0]
        inflation[i] = 1 / left if left > _COLLINEAR else math.inf
    return inflation


def shapley_values(worth: Array) -> Array:
    """Return the share of each of k players, shape (k, ...), from the worth of each subset, shape (2^k, ...)."""
    # Player i belongs to the subsets whose number has bit i; subset 0 is empty. The shares add up to the worth of all
    # players minus that of the empty set.
    k = worth.shape[0].bit_length() - 1
    subsets = np.arange(2**k)
    size = np.array([subset.bit_count() for subset in range(2**k)])
    weight = np.array([1 / (k * math.comb(k - 1, s)) if s < k else 0.0 for s in range(k + 1)])
    shares = np.empty((k, *worth.shape[1:]))
    for i in range(k):
        without = subsets[(subsets >> i & 1) == 0]
        shares[i] = np.tensordot(weight[size[without]], worth[without | 1 << i] - worth[without], axes=1)
    return shares
