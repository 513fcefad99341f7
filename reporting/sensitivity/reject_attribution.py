"""Rejects: what they have in common, the worst samples, and the part of the reject share due to each variable.

For each variable: the difference of its means among rejects and other samples with Welch's (1947) interval, and the
distance of its two distribution functions (Kolmogorov, Smirnov). With too few rejects the samples nearest to a limit
are used instead, and `RejectCauses.group` says so.

The attribution of the reject share to variables uses Shapley effects of the event "reject", from the given samples.
The worth of a set S of variables is the share of the variance of the reject indicator that they explain,
``Var(P(reject | x_S)) / (p (1 - p))``: 0 if they contain no information about rejects, 1 if they determine them. Its
Shapley values divide the reject share among the variables, whatever their correlations (target Shapley effects: Il
Idrissi, Chabridon, Iooss 2021).

``P(reject | x_S)`` is a logistic regression on the normal scores of S, their squares and products, with a ridge. It is
fitted to three quarters of the rows and judged on the fourth, so that fitted noise explains nothing. Rejects are rare,
so all of them but only a few thousand other rows are fitted, and the intercept is corrected (Prentice, Pyke 1979).
Nearest neighbours, the estimator of Il Idrissi et al., need many rows in each direction: with 4 variables and 200
rejects they give a variable without effect -0.04 to -0.06.

The samples of a campaign are determined by their variables, so all variables together explain every reject. What the
regression does not explain (`RejectAttribution.resolved` is less than 1) therefore belongs to some variables: it is
divided in proportion to the square root of what they explain, a compromise between equal and proportional parts, and
widens the intervals.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit, kolmogorov, ndtri, stdtrit
from threadpoolctl import threadpool_limits

from reporting import format_numbers
from reporting.arrays import Array, Columns, extremes, magnitude, random_rows, some_of
from reporting.capability.intervals import Interval, welch
from reporting.errors import ReportError
from reporting.sensitivity.regression import shapley_values

FEWEST = 20  # fewest samples in each of the compared groups
TAIL_SHARE = 0.01
LISTED = 5
REJECTS, TAIL = "rejects", "least margin"


@dataclass(frozen=True)
class RejectDifference:
    """Difference of one variable between the rejects and the other samples."""

    variable: str
    mean: float  # among rejects, in the unit of the variable
    mean_others: float  # among the other samples
    shift: float  # difference of the means in standard deviations of the variable
    shift_interval: Interval  # Welch's
    distance: float  # Kolmogorov's, of the distribution functions, 0 to 1; it also detects a difference in spread
    p_value: float  # of a distance at least as large if there is no difference (asymptotic)


@dataclass(frozen=True)
class RejectCauses:
    """Common properties of the rejects of a response."""

    group: str  # "rejects"; with fewer than 20, "least margin": the 1 % (at least 20) nearest to a limit
    count: int  # samples of the group
    others: int  # all other samples
    rejects: int  # values out of limits
    differences: tuple[RejectDifference, ...]  # one per variable, the largest distance first


@dataclass(frozen=True)
class WorstSample:
    """A sample near a limit or beyond it."""

    side: str  # "lower" or "upper" limit
    sample: int  # its number
    value: float  # of the response, in its unit
    margin: float  # to the limit, negative beyond it
    inputs: dict[str, float]  # values of the variables


def reject_causes(
    y: Array, inputs: Mapping[str, Array], lsl: float | None, usl: float | None, confidence: float
) -> RejectCauses | None:
    """Return the common properties of rejects; None without limits, or with fewer than 20 samples in a group."""
    if lsl is None and usl is None:
        return None
    out = (y < (-np.inf if lsl is None else lsl)) | (y > (np.inf if usl is None else usl))
    rejects, group = int(np.count_nonzero(out)), REJECTS
    if rejects < FEWEST:
        count = max(math.ceil(TAIL_SHARE * y.size), FEWEST)
        if y.size < 2 * count:
            return None
        group = TAIL
        margins = _margin(y, lsl, usl)
        last = np.partition(margins, count - 1)[count - 1]
        out = margins < last
        out[np.flatnonzero(margins == last)[: count - np.count_nonzero(out)]] = True
    outside = int(np.count_nonzero(out))
    if y.size - outside < FEWEST:
        return None
    a, b = some_of(out), some_of(~out)
    columns = Columns.of(inputs)
    differences = (_compared(name, columns.take(name, a), columns.take(name, b), confidence) for name in columns)
    ranked = sorted(differences, key=lambda d: -d.distance)
    return RejectCauses(group, outside, y.size - outside, rejects, tuple(ranked))


def _margin(y: Array, lsl: float | None, usl: float | None) -> Array:
    """Return the distance of each value from the nearer limit."""
    margins = [*([] if lsl is None else [y - lsl]), *([] if usl is None else [usl - y])]
    return np.asarray(np.minimum(margins[0], margins[-1], out=margins[0]))


def worst_samples(
    sample: NDArray[np.int64], y: Array, inputs: Mapping[str, Array], lsl: float | None, usl: float | None
) -> tuple[WorstSample, ...]:
    """Return the five samples with the smallest margin to each limit, the lower limit and the worst sample first."""
    worst, columns = [], Columns.of(inputs)
    for side, limit in (("lower", lsl), ("upper", usl)):
        if limit is None:
            continue
        rows = extremes(y, LISTED, largest=side == "upper")
        margins = y[rows] - limit if side == "lower" else limit - y[rows]
        order = np.lexsort((sample[rows], margins))
        rows, margins = rows[order], margins[order]
        of_rows = {name: columns.take(name, rows).tolist() for name in columns}
        for place, row in enumerate(rows):
            values = {name: column[place] for name, column in of_rows.items()}
            worst.append(WorstSample(side, int(sample[row]), float(y[row]), float(margins[place]), values))
    return tuple(worst)


def _compared(name: str, a: Array, b: Array, confidence: float) -> RejectDifference:
    """Compare one variable between two groups of at least two values each."""
    whole = np.concatenate([a, b])
    std = float(np.std(whole, ddof=1))
    shift, (low, high), _ = welch(a, b, confidence)
    distance = largest_distance(a, b)
    return RejectDifference(
        variable=name,
        mean=float(a.mean()),
        mean_others=float(b.mean()),
        shift=shift / std,
        shift_interval=(low / std, high / std),
        distance=distance,
        p_value=float(kolmogorov(distance * math.sqrt(a.size * b.size / whole.size))),
    )


def largest_distance(a: Array, b: Array) -> float:
    """Return the largest distance of two empirical distribution functions."""
    few, many = (np.sort(x) for x in ((a, b) if a.size < b.size else (b, a)))
    # Between two of the few one function is constant and the other rises: it is farthest away at one of the ends.
    return max(
        float(np.max(np.abs(np.searchsorted(few, few, side) / few.size - np.searchsorted(many, few, side) / many.size)))
        for side in ("left", "right")
    )


FEWEST_REJECTS = 10
MOST_ATTRIBUTED = 8  # variables; all 2^8 subsets are fitted
_LEAST_RESOLVED = 0.25
_MOST_REJECTS, _MOST_OTHERS = 500, 4000  # fitted rows
_FOLDS = 4
_RIDGE_LINEAR, _RIDGE_QUADRATIC = 0.1, 1.0  # penalties of coefficients of terms with mean 0 and variance 1
_STEPS, _LONGEST_STEP, _SMALL_STEP = 25, 4.0, 0.01  # of Newton's method, in log-odds


@dataclass(frozen=True)
class RejectShare:
    """Part of the reject share due to one variable."""

    variable: str
    share: float  # of the rejects, 0 to 1; the parts of all variables add up to 1
    interval: Interval


@dataclass(frozen=True)
class RejectAttribution:
    """Attribution of the reject share to the variables."""

    rejects: int
    n: int  # all samples
    # Share of the variance of the reject indicator that the variables explain, judged on rows that were not fitted;
    # None without a fit.
    resolved: float | None
    shares: tuple[RejectShare, ...]  # the largest first; empty if they are withheld
    note: str = ""  # why the shares are withheld, or their limitations; may be empty


def reject_attribution(
    inputs: Mapping[str, ArrayLike], rejected: ArrayLike, confidence: float = 0.95, lots: ArrayLike | None = None
) -> RejectAttribution:
    """Return the attribution of the reject share to the variables; rows where one is not finite are left out.

    `rejected` marks the rejects of one response or of the whole product; samples of one lot are not treated as
    independent. The result has no shares, but a note, if fewer than 10 samples are rejects, fewer than 10 conform,
    there are fewer than 10 lots, or the variables do not distinguish rejects from other samples. ReportError: the
    columns differ in length.
    """
    columns, out = Columns.of(inputs), np.asarray(rejected, np.bool_)
    if columns.sizes - {out.size}:
        raise ReportError("reject attribution: the columns differ in length; give columns of one table")
    finite = columns.finite
    if finite is not None:
        columns, out = columns.where(finite), out[finite]
    groups = np.arange(out.size)
    if lots is not None:
        groups = np.unique(np.asarray(lots) if finite is None else np.asarray(lots)[finite], return_inverse=True)[1]
    rejects, n = int(np.count_nonzero(out)), out.size
    varying = [name for name in columns if _varies(columns, name, n)] if n else []
    if min(rejects, n - rejects) < FEWEST_REJECTS or not varying:
        return RejectAttribution(rejects, n, None, (), _too_few(rejects, n))
    independent = n if lots is None else np.unique(groups).size
    if independent < FEWEST_REJECTS:
        return RejectAttribution(rejects, n, None, (), _too_few_of("production lots", independent))
    # The cost doubles with each variable: those that differ most among the rejects are judged.
    among, some = some_of(out), random_rows(n)
    judged = sorted(varying, key=lambda v: -largest_distance(columns.take(v, among), columns.take(v, some)))
    judged, rows = judged[:MOST_ATTRIBUTED], _case_control(out)
    scores = np.column_stack([_scores(columns.take(v, some), columns.take(v, rows)) for v in judged])
    with threadpool_limits(1):  # the matrices are small, so threads would wait for each other
        worth, influence = _worths(scores, out[rows], rejects / n)
    resolved = float(worth[-1])
    if resolved < _LEAST_RESOLVED:
        return RejectAttribution(
            rejects, n, resolved, (), "These rejects differ from other samples in no variable: no cause is named."
        )
    weight = (
        np.where(out[rows], rejects / np.count_nonzero(out[rows]), (n - rejects) / np.count_nonzero(~out[rows])) / n
    )
    error = _errors(shapley_values(influence) * weight, groups[rows])
    half = float(stdtrit(min(rejects, independent) - 1, 0.5 + confidence / 2)) * error
    shares = _divided(tuple(judged), shapley_values(worth), min(resolved, 1.0), half)
    others = [name for name in columns if name not in judged]
    left_out = tuple(RejectShare(name, 0.0, (0.0, 0.0 if name not in varying else 1 - resolved)) for name in others)
    ranked = tuple(sorted(shares, key=lambda s: -s.share))
    return RejectAttribution(rejects, n, resolved, ranked + left_out, _few(rejects, len(varying)))


def _worths(scores: Array, out: NDArray[np.bool_], p: float) -> tuple[Array, Array]:
    """Return the worth of each subset of variables, and its influence function at each row."""
    # The worth follows from ``E[g^2]``, with ``g = P(reject | x_S)``. Its efficient estimate is the mean of ``2 y g -
    # g^2`` (Da Veiga, Gamboa 2013); errors of g enter it only in the second order, and lower it.
    k, y = scores.shape[1], out.astype(np.float64)
    terms, members = _terms(scores)
    ridge = np.where((np.arange(terms.shape[1]) < k), _RIDGE_LINEAR, _RIDGE_QUADRATIC)
    rejects, others = np.count_nonzero(out), np.count_nonzero(~out)
    shift = math.log(rejects / others) - math.log(p / (1 - p))
    # Rejects are overrepresented among the fitted rows: the weights restore their share of all samples.
    weight = np.where(out, p / rejects, (1 - p) / others)
    fold = np.empty(y.size, np.int64)
    fold[out], fold[~out] = np.arange(rejects) % _FOLDS, np.arange(others) % _FOLDS
    worth, influence = np.zeros(2**k), np.zeros((2**k, y.size))
    # Terms lie one after the other in memory, so that what is computed of each runs along it.
    columns = np.vstack([np.ones(y.size), terms.T])
    folds = [np.flatnonzero(fold == each) for each in range(_FOLDS)]
    fitted = [(columns[:, fold != each], y[fold != each]) for each in range(_FOLDS)]
    for subset in range(1, 2**k):
        own = np.append(0, 1 + np.flatnonzero((members & ~subset) == 0))
        a, penalty = columns[own], np.append(1e-6, ridge[own[1:] - 1])
        b, g = np.zeros(own.size), np.empty(y.size)
        for rows, (rest, of_rest) in zip(folds, fitted, strict=True):
            b = _log_odds(rest[own], of_rest, penalty, b)
            g[rows] = (b @ a)[rows]
        g = expit(g - shift)
        square = 2 * y * g - g * g
        mean = float(weight @ square)
        worth[subset], influence[subset] = (mean - p * p) / (p - p * p), (square - mean) / (p - p * p)
    return worth, influence


def _log_odds(a: Array, y: Array, penalty: Array, start: Array) -> Array:
    """Return the coefficients of a logistic regression with a ridge, by Newton's method with bounded steps.

    `a` are the p terms of n rows, shape (p, n).
    """
    b = start.copy()
    log_odds = b @ a
    for _ in range(_STEPS):
        expected = expit(log_odds)
        spread = expected * (1 - expected) + 1e-6
        step = np.linalg.solve((a * spread) @ a.T + np.diag(penalty), a @ (y - expected) - penalty * b)
        change = step @ a
        size = magnitude(change)
        part = min(1.0, _LONGEST_STEP / max(size, _SMALL_STEP))
        b += part * step
        log_odds += part * change
        if size < _SMALL_STEP:
            break
    return b


def _terms(z: Array) -> tuple[Array, NDArray[np.int64]]:
    """Return linear terms, then squares and products, with mean 0 and variance 1, and the set of variables of each."""
    k = z.shape[1]
    pairs = [(i, j) for i in range(k) for j in range(i, k)]
    quadratic = [(z[:, i] ** 2 - 1) / math.sqrt(2) if i == j else z[:, i] * z[:, j] for i, j in pairs]
    members = [*(1 << i for i in range(k)), *(1 << i | 1 << j for i, j in pairs)]
    return np.column_stack([z, *quadratic]), np.array(members)


def _divided(names: tuple[str, ...], shapley: Array, resolved: float, half: Array) -> tuple[RejectShare, ...]:
    """Return the shares of the variables: the resolved part, and a portion of the unresolved part."""
    found = np.maximum(shapley, 0.0)
    found *= resolved / found.sum()
    part = np.sqrt(found) / np.sqrt(found).sum()
    share = found + (1 - resolved) * part
    low = np.maximum(found - half, 0.0)
    high = np.minimum(found + half + (1 - resolved) * np.clip(2 * part, 1 / part.size, 1.0), 1.0)
    return tuple(
        RejectShare(name, float(s), (float(a), float(b))) for name, s, a, b in zip(names, share, low, high, strict=True)
    )


def _errors(terms: Array, groups: NDArray[np.intp]) -> Array:
    """Return the standard error of the sum of each row of terms, shape (k, n), with independent groups of columns."""
    _, at = np.unique(groups, return_inverse=True)
    return np.array([math.sqrt(float(np.sum(np.bincount(at, row) ** 2))) for row in terms])


def _scores(column: Array, values: Array) -> Array:
    """Return the normal scores of values by their ranks in a column."""
    ordered = np.sort(column)
    ends = [np.searchsorted(ordered, values, side) for side in ("left", "right")]
    rank = np.clip((ends[0] + ends[1] + 1) / 2, 1.0, ordered.size)  # the middle one of equal values
    return np.asarray(ndtri((rank - 0.5) / ordered.size))


def _varies(columns: Columns, name: str, n: int) -> bool:
    """Return whether a column of n rows has more than one value; two of them mostly show it."""
    few = columns.take(name, np.arange(min(n, 2)))
    return bool(few[0] != few[-1]) or bool(np.ptp(columns[name]) > 0)


def _case_control(out: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the rows to fit: rejects and others, each in random order and limited in number."""
    return np.concatenate([some_of(out)[:_MOST_REJECTS], some_of(~out)[:_MOST_OTHERS]])


def _too_few(rejects: int, n: int) -> str:
    """Return why there are no shares."""
    few, word = (rejects, "rejects") if rejects <= n - rejects else (n - rejects, "conforming samples")
    if few >= FEWEST_REJECTS:
        return "No variable varies, so none costs anything."
    return _too_few_of(word, few)


def _too_few_of(word: str, few: int) -> str:
    """Return why there are no shares."""
    return f"Too few {word} ({few}) to say which variable costs how much: at least {FEWEST_REJECTS} are needed."


def _few(rejects: int, variables: int) -> str:
    """Return the limitations of the shares."""
    few = f"From {format_numbers.grouped(rejects)} rejects only: the order of the variables is rough."
    many = f"Only the {MOST_ATTRIBUTED} variables that differ most among the rejects have a share of their own."
    return " ".join(text for holds, text in ((rejects < 50, few), (variables > MOST_ATTRIBUTED, many)) if holds)
