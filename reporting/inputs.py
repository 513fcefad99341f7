"""Comparison of the drawn variables with the requested distributions: moments, bounds, distance, correlations."""

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.special import kolmogorov

from reporting.arrays import Array, centred_ranks, random_rows, standard_deviation, sums
from reporting.samples import Samples
from reporting.sensitivity.reject_attribution import largest_distance
from reporting.shape.histogram import Histogram, histogram
from reporting.shape.sorted_sample import sorted_sample
from reporting.spec import ReportSpec, VariableSpec

_FEWEST = 30


@dataclass(frozen=True)
class VariableAnalysis:
    """A sampled variable as requested and as drawn, over all samples including failed ones."""

    spec: VariableSpec
    n: int  # finite values
    mean: float | None  # mean to maximum are in the variable's unit
    std: float | None
    min: float | None
    max: float | None
    outside: int  # values beyond the bounds, or missing
    histogram: Histogram | None
    # Deviations of mean and sigma from the requested ones in standard errors; with production batches these are the
    # standard errors of whole batches. None below 30 values (batches), or for a constant.
    mean_errors: float | None = None
    std_errors: float | None = None
    # Kolmogorov's: the largest difference between the drawn and the requested cumulative distribution
    distance: float | None = None
    # of a distance as large by chance, for independent values; None with production batches
    p_value: float | None = None


@dataclass(frozen=True)
class CorrelationAnalysis:
    """Spearman's rank correlation of two variables, as requested and as drawn."""

    first: str
    second: str
    asked: float  # requested
    found: float  # drawn
    errors: float  # their difference in standard errors, ``(1 - asked^2) / sqrt(n - 1)``


def analyse_variable(spec: VariableSpec, values: Array, sample: NDArray[np.int64]) -> VariableAnalysis:
    """Compare the drawn values of a variable, NaN where missing, with the requested distribution.

    The sample numbers, shape (n,), determine the production batch.
    """
    is_finite = np.isfinite(values)
    if is_finite.all():
        finite, numbers = values, sample
    else:
        finite, numbers = values[is_finite], sample[is_finite]
    ordered = sorted_sample(finite)
    low = -math.inf if spec.lower is None else spec.lower
    high = math.inf if spec.upper is None else spec.upper
    n = int(finite.size)
    mean_errors, std_errors = _errors(spec, finite, numbers)
    distance = _distance(spec, ordered.values)
    return VariableAnalysis(
        spec=spec,
        n=n,
        mean=float(np.mean(finite)) if n else None,
        std=standard_deviation(finite, ddof=1) if n > 1 else None,
        min=float(ordered.values[0]) if n else None,
        max=float(ordered.values[-1]) if n else None,
        outside=values.size
        - int(np.searchsorted(ordered.values, high, "right"))
        + int(np.searchsorted(ordered.values, low)),
        histogram=histogram(ordered, *((spec.lower, spec.upper) if low < high else ())),
        mean_errors=mean_errors,
        std_errors=std_errors,
        distance=distance,
        p_value=None if distance is None or spec.batch else float(kolmogorov(distance * math.sqrt(n))),
    )


def analyse_correlations(spec: ReportSpec, samples: Samples) -> tuple[CorrelationAnalysis, ...]:
    """Return the requested rank correlations and the largest of the others; empty below 30 samples."""
    names = [v.name for v in spec.variables if v.std > 0]
    if len(names) < 2:
        return ()
    rows = np.sort(random_rows(samples.sample.size))  # of a quasi-random sequence the first rows are no sample
    complete = np.all([np.isfinite(samples.values[name][rows]) for name in names], axis=0)
    n = int(np.count_nonzero(complete))
    if n < _FEWEST:
        return ()
    ranks = {name: centred_ranks(samples.values[name][rows][complete]) for name in names}
    requests = {frozenset((a, b)): rank for a, b, rank in spec.correlations}
    requested: list[CorrelationAnalysis] = []
    others: list[CorrelationAnalysis] = []
    for a, b in combinations(names, 2):
        scale = float(np.linalg.norm(ranks[a]) * np.linalg.norm(ranks[b]))
        drawn, asked = float(ranks[a] @ ranks[b]) / scale if scale else 0.0, requests.get(frozenset((a, b)), 0.0)
        errors = (drawn - asked) / (1 - asked**2) * math.sqrt(n - 1)
        pair = CorrelationAnalysis(a, b, asked, drawn, errors)
        (requested if frozenset((a, b)) in requests else others).append(pair)
    return (*requested, *sorted(others, key=lambda pair: -abs(pair.errors))[:1])


def _errors(spec: VariableSpec, x: Array, sample: NDArray[np.int64]) -> tuple[float | None, float | None]:
    """Return the deviations of mean and sigma from the requested ones in standard errors (of batches, if any)."""
    if spec.std <= 0 or x.size < _FEWEST:
        return None, None

    def columns(piece: Array) -> tuple[Array, Array]:
        deviation = piece - spec.mean
        return deviation, np.square(deviation) - spec.std**2

    if spec.batch:
        _, group = np.unique(sample // spec.batch, return_inverse=True)
        if int(group.max()) + 1 < _FEWEST:
            return None, None
        of_batches = [np.bincount(group, weights=column).astype(np.float64) for column in columns(x)]
        totals = [(float(np.sum(column)), float(np.std(column)) * math.sqrt(column.size)) for column in of_batches]
    else:
        of_all = sums(x, columns)
        means = np.array(of_all)[:, None] / x.size
        around = sums(x, lambda piece: tuple(np.square(columns(piece) - means)))
        totals = [(total, math.sqrt(square)) for total, square in zip(of_all, around, strict=True)]
    mean_errors, std_errors = (abs(total) / error if error > 0 else 0.0 for total, error in totals)
    return mean_errors, std_errors


def _distance(spec: VariableSpec, x: Array) -> float | None:
    """Return Kolmogorov's distance of ascending values at points of the requested distribution; None below 30."""
    if not spec.cdf or x.size < _FEWEST or spec.std <= 0:
        return None
    at, p = np.asarray(spec.cdf, np.float64).T
    return float(np.max(np.abs(np.searchsorted(x, at, side="right") / x.size - p)))


# What separates the failed samples from the ok ones: each variable in both groups.
#
# Failures often come from one variable, on one side of its range or at both ends, where a tolerance is too large or was
# mistyped. So two distances of the distributions (Kolmogorov, Smirnov) are taken: of the values, and of their distances
# from the requested mean. The larger one ranks the variables. Two samples in a group are enough, which may be all that
# is left.


@dataclass(frozen=True)
class FailedAgainstOk:
    """One variable among the failed and among the ok samples, in its unit."""

    variable: str
    mean_failed: float
    low_failed: float  # smallest value
    high_failed: float  # largest value
    mean_ok: float
    low_ok: float
    high_ok: float
    distance: float  # of the distribution functions, 0 to 1: of the values, or of their distances from the mean
    p: float  # probability of a distance at least as large by chance (asymptotic, doubled for the two distances)


def failed_against_ok(samples: Samples, variables: tuple[VariableSpec, ...]) -> tuple[FailedAgainstOk, ...]:
    """Compare each variable that varies between failed and ok samples, the clearest difference first.

    Empty without a sample in one of the groups, or without variables that vary.
    """
    found = []
    for spec in variables:
        x = samples.values[spec.name]
        failed, ok = x[~samples.ok & np.isfinite(x)], x[samples.ok & np.isfinite(x)]
        if failed.size and ok.size and max(failed.max(), ok.max()) > min(failed.min(), ok.min()):
            found.append(_compared(spec, failed, ok))
    return tuple(sorted(found, key=lambda each: (-each.distance, each.p)))


def _compared(spec: VariableSpec, failed: Array, ok: Array) -> FailedAgainstOk:
    a, b = failed[random_rows(failed.size)], ok[random_rows(ok.size)]
    distance = max(largest_distance(a, b), largest_distance(np.abs(a - spec.mean), np.abs(b - spec.mean)))
    root = math.sqrt(a.size * b.size / (a.size + b.size))
    p = min(2 * float(kolmogorov(distance * root)), 1.0)
    return FailedAgainstOk(spec.name, *_extent(failed), *_extent(ok), distance, p)


def _extent(x: Array) -> tuple[float, float, float]:
    return float(x.mean()), float(x.min()), float(x.max())
