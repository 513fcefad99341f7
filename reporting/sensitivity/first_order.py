"""First-order Sobol' indices of a given sample, and the conditional expectations behind them.

The first-order index is the share of a response's variance that one variable explains alone,
``Var(E[y | x_i]) / Var(y)`` (Sobol' 1993). It is estimated from the campaign's own sample. ``E[y | x_i]`` is a
polynomial of x_i; its degree, the same for all variables, is the one with the smallest error on left-out groups of rows
(cross-validation). Independent variables are fitted together, ``y = f_1(x_1) + ... + f_k(x_k)``, so that the effects of
the others do not act as noise. Correlated variables are fitted one at a time, so that the index keeps its meaning. If a
residual shows structure, such as a jump, ranks estimate what the polynomial misses. The delete-a-group
jackknife (Efron, Stein 1981) removes the bias of fitted noise and gives the intervals; near zero their coverage is a
few percent too low.

Root mean square error, the largest over the variables (`tests/reporting/sensitivity/test_first_order.py`):

=========================  ==========  ============  ============
n, model                   together    one at a time classes
=========================  ==========  ============  ============
100, Ishigami              0.09        0.09          0.12
500, Ishigami              0.035       0.035         0.045
30,000, Ishigami           0.004       0.004         0.004
500, linear, 7 variables   0.035       0.035         0.035
=========================  ==========  ============  ============

"Classes" are 2 n^(1/3) classes of equal probability with the unbiased variance within them. For small shares the joint
fit is 4 to 10 times more accurate than either of the others.

A polynomial of a variable cannot follow a jump or many bends. What it misses appears in its residual: in the order of
the variable, neighbours then have similar residuals. For neighbours (e, e') the mean of e e' estimates
``Var(E[e | x])``, whatever its shape (the rank-based estimator: Chatterjee 2021; Gamboa, Gremaud, Klein, Lagnoux 2022).
With the polynomial f as control variate,

``Var(E[y | x]) = Var(f) + 2 Cov(f, e) + Var(E[e | x])``,

so that ranks have to estimate only the remainder. If the residual shows no structure, the polynomial alone is more
accurate, and what it may have missed extends the interval upwards.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from reporting.arrays import Array
from reporting.sensitivity.polynomials import Sums

STRUCTURED = 2.5  # standard errors above 0
MOST_ROWS = 50_000
_ONE_SIDED = 1.645  # 95 %
# A residual with a smaller share of the variance is rounding.
_ROUNDING = 1e-9
_FEWEST_ALIKE, _MOST_CUTS, _CLEAR = 5, 5, 4.5  # least values on a side, most places, least standard errors


@dataclass(frozen=True)
class RankBased:
    """Rank-based estimates for a variable whose polynomial leaves a residual."""

    # first-order index over all rows and without each of g groups, shape (1 + g,); None: no structure
    share: Array | None
    missed: float  # share that the polynomial may have missed (one-sided, 95 %); 0 if `share` is given
    carriers: float  # samples that carry the variable's share: ``(sum c)^2 / sum c^2``, c the squared effects


def rank_based(x: Array, effect: Array, residual: Array, y: Array, group: NDArray[np.intp]) -> RankBased:
    """Return the rank-based estimates for a variable x, (n,), from its polynomial's effect and the residual of y."""
    order = np.argsort(x, kind="stable")
    f, e = effect[order] - effect.mean(), residual[order] - residual.mean()
    if np.mean(e * e) < _ROUNDING:
        return RankBased(None, 0.0, _carriers(f))
    found, error = _neighbours(e, min(max(x.size // 100, 1), 20))  # more lags: less noise, more bias
    if found <= STRUCTURED * error:
        return RankBased(None, max(found + _ONE_SIDED * error, 0.0), _carriers(f))
    group, ordered = group[order], y[order]
    most = min(max(x.size // 400, 1), 10)
    rest = [slice(None), *(group != g for g in range(int(group.max()) + 1))]
    share = [_explained(f[rows], e[rows], most) / float(np.var(ordered[rows])) for rows in rest]
    padded = np.concatenate([e[1:2], e, e[-2:-1]])
    smooth = (padded[:-2] + padded[2:]) / 2  # the mean of the two neighbours of each value
    return RankBased(np.array(share), 0.0, _carriers(f + smooth))


def _explained(f: Array, e: Array, most: int) -> float:
    """Return Var(E[y | x]), where f is the effect and e the residual in the order of the variable."""
    f, e = f - f.mean(), e - e.mean()
    return float(np.mean(f * f) + 2 * np.mean(f * e)) + _neighbours(e, most)[0]


def _neighbours(e: Array, most: int) -> tuple[float, float]:
    """Return the mean product of values up to `most` places apart, and its standard error without structure."""
    products = [e[lag:] * e[:-lag] for lag in range(1, most + 1)]
    count = sum(p.size for p in products)
    return sum(float(p.sum()) for p in products) / count, float(np.sqrt(sum(float(p @ p) for p in products))) / count


def _carriers(effect: Array) -> float:
    """Return the number of samples that carry the variance of an effect, or of a residual."""
    square = (effect - effect.mean()) ** 2
    total = float(square.sum())
    return total * total / float(square @ square) if total > 0 else float(effect.size)


def cuts(x: Array, residual: Array) -> list[tuple[float, float]]:
    """Return at most five places where a residual jumps along a variable, and the jumps in standard errors."""
    # At each place the means of the values before and after it are compared, each over a hundredth of the sample.
    order = np.argsort(x, kind="stable")
    e, width = residual[order] - residual.mean(), max(x.size // 100, _FEWEST_ALIKE)
    spread = float(e.std())
    if spread**2 < _ROUNDING or x.size < 4 * width:
        return []
    total = np.append(0.0, np.cumsum(e))
    contrast = np.abs(total[2 * width :] - 2 * total[width:-width] + total[: -2 * width]) / (
        spread * np.sqrt(2.0 * width)
    )
    found: list[tuple[float, float]] = []
    while len(found) < _MOST_CUTS:
        at = int(np.argmax(contrast))
        if contrast[at] < _CLEAR:
            break
        place = at + width
        found.append((float(x[order[place - 1]] + x[order[place]]) / 2, float(contrast[at])))
        # The windows of these places contain the jump just found.
        contrast[max(at - 2 * width, 0) : at + 2 * width] = 0.0
    return found


MOST_DEGREE = 10
_ROWS_PER_COEFFICIENT = 5
CURVE_POINTS = 33
# Added to the normal equations, whose diagonal is 1, because collinear variables make them singular.
_RIDGE = 1e-10
# Errors that differ by a smaller share of the variance are treated as equal.
_SAME_ERROR = 1e-9


@dataclass(frozen=True)
class Effects:
    """Effects of each of k variables alone on each of m responses."""

    degree: NDArray[np.int64]  # of the polynomials, shape (m,)
    share: Array  # first-order index, possibly below 0 by chance, shape (m, k)
    share_error: Array  # standard error
    unexplained: Array  # share of the variance that is not a sum of functions of single variables, shape (m,)
    unexplained_error: Array
    residual_carriers: Array  # number of samples that carry the unexplained share, shape (m,)
    curve_x: Array  # evenly spaced from the 5th to the 95th percentile of each variable, shape (k, points)
    curve: Array  # ``E[y | x_i]`` there minus the mean of y, in standard deviations of y, shape (m, k, points)
    swing_error: Array  # of ``max - min`` of the curve, in standard deviations of y, shape (m, k)
    by_ranks: NDArray[np.bool_]  # the polynomial misses a structure such as a jump, shape (m, k)
    missed: Array  # upper bound of what the polynomial misses, a share that extends the interval upwards, (m, k)
    carriers: Array  # number of samples that carry the share, shape (m, k)


def most_degree(n: int, variables: int) -> int:
    """Return the highest degree to fit to n rows: at least five rows for each coefficient."""
    return min(max((n // _ROWS_PER_COEFFICIENT - 1) // variables, 1), MOST_DEGREE)


def effects(
    sums: Sums, x: Array, y: Array, group: NDArray[np.intp], ends: tuple[Array, Array], *, independent: bool
) -> Effects:
    """Return the effects of the variables x, shape (n, k), on the responses y, shape (n, m)."""
    # `sums` and `group` are those of the rows, `ends` the 5th and the 95th percentile of each variable. Independent
    # variables are fitted together.
    k = sums.basis.mean.size
    degree = 1 + best_columns(sums, [np.arange(1 + k * d) for d in range(1, sums.basis.degree + 1)])
    curve_x = np.linspace(*ends, CURVE_POINTS, axis=1)
    m, groups = degree.size, sums.rows.size
    share, unexplained = np.zeros((1 + groups, m, k)), np.zeros((1 + groups, m))
    curve = np.zeros((1 + groups, m, k, CURVE_POINTS))
    by_ranks, missed, carriers = np.zeros((m, k), np.bool_), np.zeros((m, k)), np.zeros((m, k))
    residual_carriers = np.zeros(m)
    points, some = sums.basis(curve_x.T), x[:MOST_ROWS]
    values, z = sums.basis(some), ((y - y.mean(axis=0)) / y.std(axis=0))[:MOST_ROWS]
    parts = sums.without_each()
    for d in np.unique(degree):
        at = np.flatnonzero(degree == d)
        together = least_squares(parts, np.arange(1 + k * d))
        unexplained[:, at] = unexplained_share(sums, parts, together, np.arange(1 + k * d))[:, at]
        effect = np.zeros((k, some.shape[0], at.size))
        for i in range(k):
            own = sums.basis.columns(i, int(d))
            b = together[:, own] if independent else least_squares(parts, np.append(0, own))[:, 1:]
            b = b[:, :, at]
            share[:, at, i] = _variance_of(parts, own, b) / variance(parts)[:, at]
            shape = points[:, own] - (parts.bb[:, 0, own] / parts.rows[:, None])[:, None]
            curve[:, at, i] = np.einsum("gxc,gcm->gmx", shape, b)
            effect[i] = values[:, own] @ b[0]
        residual = z[:, at] - (effect.sum(axis=0) if independent else effect)  # of each variable if fitted alone
        left = z[:, at] - values[:, : 1 + k * d] @ together[0][:, at]
        residual_carriers[at] = [_carriers(e) for e in left.T]
        for (j, r), i in product(enumerate(at), range(k)):
            e = residual[:, j] if independent else residual[i, :, j]
            found = rank_based(some[:, i], effect[i, :, j], e, z[:, r], group[:MOST_ROWS])
            missed[r, i], carriers[r, i] = found.missed, found.carriers
            if found.share is not None:
                by_ranks[r, i] = True
                unexplained[:, r] -= found.share - share[:, r, i] if independent else 0.0
                share[:, r, i] = found.share
    swing = curve.max(axis=3) - curve.min(axis=3)
    # The jackknife's correction of the bias: noise that is fitted counts as effect.
    corrected = share[0] * groups - (groups - 1) * share[1:].mean(axis=0)
    # Ranks need no correction for fitted noise: the residual lacks what the polynomial fits in excess. It would only
    # add the error of neighbours on either side of a jump.
    missed = np.where(by_ranks, np.maximum(corrected - share[0], 0.0), missed)
    return Effects(
        degree=degree,
        share=np.where(by_ranks, share[0], corrected),
        share_error=jackknife_error(share),
        unexplained=unexplained[0],
        unexplained_error=jackknife_error(unexplained),
        residual_carriers=residual_carriers,
        curve_x=curve_x,
        curve=curve[0],
        swing_error=jackknife_error(swing),
        by_ranks=by_ranks,
        missed=missed,
        carriers=carriers,
    )


def best_columns(sums: Sums, candidates: Sequence[NDArray[np.intp]]) -> NDArray[np.int64]:
    """Return the first candidate set of columns with the smallest error on left-out groups, for each response."""
    rest, errors = sums.without_each(), []
    for columns in candidates:
        errors.append(_left_out(sums, least_squares(rest, columns), columns))
    rounding = _SAME_ERROR * sums.yy.sum(axis=0)
    return np.asarray(np.argmax(np.array(errors) <= np.min(errors, axis=0) + rounding, axis=0))


def _left_out(sums: Sums, b: Array, columns: NDArray[np.intp]) -> Array:
    """Return the sum of squared errors on each group of rows, by the coefficients without it; shape (m,)."""
    rest = b[1:]
    gram, cross = sums.bb[:, columns[:, None], columns], sums.by[:, columns]
    return np.asarray(np.sum(sums.yy - 2 * np.sum(rest * cross, axis=1) + np.sum(rest * (gram @ rest), axis=1), axis=0))


def least_squares(parts: Sums, columns: NDArray[np.intp]) -> Array:
    """Return the regression coefficients of the responses on some columns of the basis, shape (g, p, m)."""
    n = parts.rows[:, None, None]
    gram = parts.bb[:, columns[:, None], columns] / n + _RIDGE * np.eye(columns.size)
    return np.asarray(np.linalg.solve(gram, parts.by[:, columns] / n))


def variance(parts: Sums) -> Array:
    """Return the variance of the responses with divisor n, shape (g, m)."""
    n = parts.rows[:, None]
    return np.asarray(parts.yy / n - (parts.by[:, 0] / n) ** 2)


def jackknife_error(estimates: Array) -> Array:
    """Return the standard error; the first axis holds the estimate, then the estimates without each group."""
    without = estimates[1:]
    g = without.shape[0]
    return np.asarray(np.sqrt((g - 1) / g * np.sum((without - without.mean(axis=0)) ** 2, axis=0)))


def jackknife_quantile(groups: int, confidence: float) -> float:
    """Return the half width of an interval in standard errors: Student's t for `groups` groups."""
    return float(stdtrit(groups - 1, 0.5 + confidence / 2))


def _variance_of(parts: Sums, own: NDArray[np.intp], b: Array) -> Array:
    """Return the variance of a variable's polynomial over the rows, shape (g, m)."""
    n = parts.rows[:, None, None]
    mean = parts.bb[:, :1, own] / n
    covariance = parts.bb[:, own[:, None], own] / n - mean.transpose(0, 2, 1) * mean
    return np.asarray(np.sum(b * (covariance @ b), axis=1))


def unexplained_share(sums: Sums, parts: Sums, b: Array, columns: NDArray[np.intp]) -> Array:
    """Return the share of the variance that a regression leaves, of all rows and without each group; shape (1 + g, m).

    Rows far out weigh most in a fit, and a curved response is off by most there: their residuals are too small by more
    than the degrees of freedom say. The mean of the squared residual and of the squared error on left-out groups,
    about ``(1 - h) s^2`` and ``s^2 / (1 - h)`` for a row of variance s^2 and leverage h, is right for each row.
    """
    n = parts.rows[:, None]
    residual = np.maximum(parts.yy - np.sum(b * parts.by[:, columns], axis=1), 0.0)
    freed = residual * n / np.maximum(n - columns.size, 1.0)
    whole = (residual[0] + _left_out(sums, b, columns)) / 2
    freed *= np.divide(whole, freed[0], out=np.ones_like(whole), where=freed[0] > 0)
    return np.asarray(freed / n / (variance(parts) * n / (n - 1)))
