"""First-order indices of responses with jumps: ranks estimate what a polynomial leaves in its residual.

A polynomial of a variable cannot follow a jump or many bends. What it misses appears in its residual: in the order of
the variable, neighbours then have similar residuals. For neighbours (e, e') the mean of e e' estimates
``Var(E[e | x])``, whatever its shape (the rank-based estimator: Chatterjee 2021; Gamboa, Gremaud, Klein, Lagnoux 2022).
With the polynomial f as control variate,

``Var(E[y | x]) = Var(f) + 2 Cov(f, e) + Var(E[e | x])``,

so that ranks have to estimate only the remainder. If the residual shows no structure, the polynomial alone is more
accurate, and what it may have missed extends the interval upwards.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from reporting.arrays import Array

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
    """Return the rank-based estimates for a variable x, shape (n,), with rows in random order.

    `effect` is its polynomial, `residual` the standardised response y minus all fitted terms; `group`, from 0, of each
    row.
    """
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
    return RankBased(np.array(share), 0.0, _carriers(f + _smooth(e)))


def _explained(f: Array, e: Array, most: int) -> float:
    """Return Var(E[y | x]), where f is the effect and e the residual in the order of the variable."""
    f, e = f - f.mean(), e - e.mean()
    return float(np.mean(f * f) + 2 * np.mean(f * e)) + _neighbours(e, most)[0]


def _neighbours(e: Array, most: int) -> tuple[float, float]:
    """Return the mean product of values up to `most` places apart, and its standard error without structure."""
    products = [e[lag:] * e[:-lag] for lag in range(1, most + 1)]
    count = sum(p.size for p in products)
    return sum(float(p.sum()) for p in products) / count, float(np.sqrt(sum(float(p @ p) for p in products))) / count


def _smooth(e: Array) -> Array:
    """Return the mean of the two neighbours of each value."""
    padded = np.concatenate([e[1:2], e, e[-2:-1]])
    return np.asarray((padded[:-2] + padded[2:]) / 2)


def _carriers(effect: Array) -> float:
    """Return the number of samples that carry the variance of an effect."""
    square = (effect - effect.mean()) ** 2
    total = float(square.sum())
    return total * total / float(square @ square) if total > 0 else float(effect.size)


def cuts(x: Array, residual: Array) -> list[tuple[float, float]]:
    """Return at most five places where a residual jumps along a variable, and the jumps in standard errors.

    At each place the means of the values before and after it are compared, each over a hundredth of the sample.
    """
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
