"""The smallest margin of the responses' Cpk over their targets, as a function of the factor on one spread.

For changes too large for reweighting the samples a response is a polynomial of the variables.
The model moves the samples: if the variables x of a sample become x', its response becomes ``y + g(x') - g(x)`` with
the least-squares polynomial g. A change of one marginal distribution that keeps the ranks also keeps the copula, so the
correlation of variables is unchanged. The residual of g stays with its sample.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from reporting.arrays import Array
from reporting.capability.intervals import Interval
from reporting.tolerance.reweighting import Change, LotLabels, by_lot, mean_interval
from reporting.tolerance.whatif import WhatIf, too_few, what_if_all

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
        """Return which terms change if some variables have other values, and by how much, (n, changed terms)."""
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
    """Return the polynomial of one response; None with too few values or too large an unexplained share."""
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
    """Return Cpk with some variables moved, and its interval; None without spread."""
    # The interval allows for the errors of the samples and of the coefficients; its lower end also allows for a
    # residual that grows with the variables. `change` has the new standardised values, shape (n,), by index of the
    # variable, and the factor on their standard deviations. At least one limit is needed.
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


_UP, _DOWN = 1.1, 0.85  # steps of the factor
_REFINEMENTS = 3  # of a crossing, and of the end of the range with answers
# No change may make a larger share of runs fail, because this would matter more than any index of the others. If more
# runs fail already, at most a tenth more may fail.
MOST_FAILED, _MORE_FAILED = 0.01, 1.1
FAILURES = "runs without a value"
ROUNDING = 1e-9  # of a share

Limits = Mapping[str, tuple[float | None, float | None]]
# Low end, value and high end of Cpk by response.
Indices = dict[str, tuple[float, float, float]]


@dataclass(frozen=True)
class Margin:
    """The smallest margin over the targets: of Cpk, and of the ends of its interval."""

    low: float  # of the lower end, the smallest over all responses; likewise the others
    value: float
    high: float
    response: str  # the one with the smallest margin, or "runs without a value"
    cpk: float | None  # of that response; None for runs without a value
    effective: float | None  # sample size; None without reweighting


@dataclass(frozen=True)
class Question:
    """Responses with limits and targets, and the variables, at the same samples."""

    responses: Mapping[str, Array]  # shape (n,)
    limits: Limits
    targets: Mapping[str, float]
    columns: Mapping[str, Array]  # of the varying variables, shape (n,)
    confidence: float  # two-sided
    lots: LotLabels | None  # shape (n,)

    def weighted(self, change: Change) -> tuple[Indices, WhatIf] | str:
        """Return the indices by reweighting and the answer with most missing runs, or why there is none."""
        answers = what_if_all(self.responses, change, self.limits, self.confidence, self.lots)
        for answer in answers.values():
            if answer.refusal:
                return answer.refusal
        indices = {
            name: (answer.cpk.interval[0], answer.cpk.value, answer.cpk.interval[1])
            for name, answer in answers.items()
            if answer.cpk is not None  # a response without spread keeps its target
        }
        return indices, max(answers.values(), key=lambda answer: answer.missing or 0.0)

    def reweighted(self, change: Change) -> Margin | str:
        """Return the margin by reweighting, or why there is none."""
        # Runs without a value have a margin too: their share must not exceed 1 %, or 1.1 times the present share.
        found = self.weighted(change)
        if isinstance(found, str):
            return found
        indices, worst = found
        allowed = max(MOST_FAILED, _MORE_FAILED * worst.dropped / max(worst.n + worst.dropped, 1)) + ROUNDING
        return self._least(indices, worst.effective, allowed - (worst.missing or 0.0))

    def modelled(self, variable: str, change: Change, factor: float) -> Margin | str:
        """Return the margin by moving the samples with the polynomials of the responses, or why there is none."""
        indices = self.moved(variable, change, factor)
        return indices if isinstance(indices, str) else self._least(indices, None)

    def moved(self, variable: str, change: Change, factor: float) -> Indices | str:
        """Return the indices by moving the samples with the polynomials of the responses, or why there is none."""
        moved = {name: np.asarray(x, np.float64) for name, x in change.moved_to(variable).items()}
        if not moved or not moved.keys() <= self.columns.keys():
            return f"{variable} has no density"
        if isinstance(self._surfaces, str):
            return self._surfaces
        far = next((name for name, to in moved.items() if beyond(self.columns[name], to) > MOST_BEYOND), "")
        if far:
            return f"more than {100 * MOST_BEYOND:g} % of the values of {far} would lie beyond those of the campaign"
        if factor > 1 and not all(np.isfinite(y).all() for y in self.responses.values()):
            return "some runs have no value, and no polynomial tells how many more would have none"
        indices: Indices = {}
        for name, surface in self._surfaces.items():
            has = np.isfinite(self.responses[name])
            standard = {
                list(self.columns).index(v): (to[has] - self.columns[v][has].mean()) / self.columns[v][has].std()
                for v, to in moved.items()
            }
            lots = None if self.lots is None else self.lots[has]
            count = int(np.count_nonzero(has))
            if refusal := too_few(count, np.ones(count), lots):
                return refusal
            found = moved_cpk(surface, (standard, factor), self.limits[name], self.confidence, lots)
            if found is not None:
                indices[name] = (found[1][0], found[0], found[1][1])
        return indices

    @cached_property
    def _surfaces(self) -> dict[str, Surface] | str:
        """A polynomial of each response, or the name of a response that no polynomial explains."""
        surfaces = {}
        for name, y in self.responses.items():
            has = np.isfinite(y)
            surface = fit_surface(y[has], {v: x[has] for v, x in self.columns.items()})
            if surface is None:
                return f"no polynomial of the variables explains {name}"
            surfaces[name] = surface
        return surfaces

    def _least(self, indices: Indices, effective: float | None, spare: float = math.inf) -> Margin | str:
        """Return the smallest margins over the responses' low end, value and high end of Cpk, and over failures."""
        if not indices:
            return "no response has a spread"
        low, value, high = (
            min(ends[level] - self.targets[name] for name, ends in indices.items()) for level in range(3)
        )
        if spare < min(value, 0.0):  # a share is not an index: it counts only if it is exceeded
            return Margin(min(low, spare), spare, min(high, spare), FAILURES, None, effective)
        response = min(indices, key=lambda name: indices[name][1] - self.targets[name])
        return Margin(low, value, high, response, indices[response][1], effective)


class IndexCurve:
    """The margin at factors outwards from 1, by `ask`, until there is no answer or the targets are crossed."""

    def __init__(self, ask: Callable[[float], Margin | str], least: float, most: float) -> None:
        self._ask = ask
        now = ask(1.0)
        self.refusal = now if isinstance(now, str) else ""
        self._points: dict[float, Margin] = {} if isinstance(now, str) else {1.0: now}
        if not isinstance(now, str):
            if now.high >= 0:
                self._walk(_UP, most, lambda margin: margin.high < 0)
            if now.low < 0:
                self._walk(_DOWN, least, lambda margin: margin.low >= 0)

    @property
    def now(self) -> Margin:
        """The margin at the present spread."""
        return self._points[1.0]

    @property
    def ends(self) -> tuple[float, float]:
        """The smallest and the largest factor with an answer."""
        return min(self._points), max(self._points)

    def at(self, factor: float) -> Margin:
        """Return the margin at a factor, or at the nearest factor towards 1 with an answer."""
        margin = self._ask(factor)
        if not isinstance(margin, str):
            return margin
        inward = [f for f in self._points if min(1.0, factor) <= f <= max(1.0, factor)]
        return self._points[min(inward, key=lambda f: abs(f - factor))]

    def crossing(self, level: str) -> float | None:
        """Return the factor nearest to 1 at which a level crosses zero; None if it does not."""
        above = getattr(self.now, level) >= 0
        outward = sorted((f for f in self._points if (f >= 1 if above else f <= 1)), reverse=not above)
        crossed = next((i for i, f in enumerate(outward) if (getattr(self._points[f], level) >= 0) != above), None)
        if crossed is None:
            return None
        near, far = ((f, float(getattr(self._points[f], level))) for f in outward[crossed - 1 : crossed + 1])
        for _ in range(_REFINEMENTS):
            between = _zero(near, far)
            margin = self._ask(between)
            if isinstance(margin, str):
                break
            value = float(getattr(margin, level))
            near, far = ((between, value), far) if (value >= 0) == above else (near, (between, value))
        return _zero(near, far)

    def _walk(self, step: float, limit: float, crossed: Callable[[Margin], bool]) -> None:
        """Add points outwards from 1, until the limit, a refusal or a crossing."""
        inner = 1.0
        while inner != limit:
            outer = min(inner * step, limit) if step > 1 else max(inner * step, limit)
            margin = self._ask(outer)
            if isinstance(margin, str):
                self._approach(inner, outer)
                return
            self._points[outer] = margin
            if crossed(margin):
                return
            inner = outer

    def _approach(self, inner: float, outer: float) -> None:
        """Add points close to a refusal."""
        for _ in range(_REFINEMENTS):
            middle = math.sqrt(inner * outer)
            margin = self._ask(middle)
            if isinstance(margin, str):
                outer = middle
            else:
                self._points[middle] = margin
                inner = middle


def _zero(near: tuple[float, float], far: tuple[float, float]) -> float:
    """Return the factor at which the line through two points (factor, level) is zero, between the two."""
    share = near[1] / (near[1] - far[1]) if near[1] != far[1] else 0.5
    return near[0] + min(max(share, 0.0), 1.0) * (far[0] - near[0])
