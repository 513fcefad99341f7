"""Were the variables drawn as asked: moments, bounds, distribution, correlations."""

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.special import kolmogorov

from reporting.arrays import Array
from reporting.samples import Samples
from reporting.shape.histogram import Histogram, histogram
from reporting.spec import ReportSpec, VariableSpec

_FEWEST = 30
_ROWS = 200_000  # know a rank correlation to 0.002


@dataclass(frozen=True)
class VariableAnalysis:
    """A sampled input: what was asked and what was drawn, over all samples, failed ones too.

    Attributes
    ----------
    spec : VariableSpec
    n : int
        Finite values.
    mean, std, min, max : float or None
        In the variable's unit.
    outside : int
        Values beyond the bounds, or missing.
    histogram : Histogram or None
    mean_errors, std_errors : float or None
        How many standard errors mean and sigma are off. Of production batches the standard errors are those of whole
        batches. None below 30 values (batches), or for a constant.
    distance : float or None
        Largest difference between the share of values below any value and the probability asked for (Kolmogorov).
    p_value : float or None
        Of a distance this large by chance, for independent values; None with production batches.
    """

    spec: VariableSpec
    n: int
    mean: float | None
    std: float | None
    min: float | None
    max: float | None
    outside: int
    histogram: Histogram | None
    mean_errors: float | None = None
    std_errors: float | None = None
    distance: float | None = None
    p_value: float | None = None


@dataclass(frozen=True)
class CorrelationAnalysis:
    """Spearman's rank correlation of two variables, as asked and as found.

    Attributes
    ----------
    first, second : str
    asked, found : float
    errors : float
        Their difference in standard errors, ``(1 - asked^2) / sqrt(n - 1)``.
    """

    first: str
    second: str
    asked: float
    found: float
    errors: float


def analyse_variable(spec: VariableSpec, values: Array, sample: NDArray[np.int64]) -> VariableAnalysis:
    """Compare what was drawn with what was asked.

    Parameters
    ----------
    spec : VariableSpec
        What was asked.
    values : array, shape (n,)
        What was drawn, NaN where it is missing.
    sample : array of int64, shape (n,)
        Sample numbers, which say the production batch.
    """
    kept = np.isfinite(values)
    finite = values[kept]
    low = -math.inf if spec.lower is None else spec.lower
    high = math.inf if spec.upper is None else spec.upper
    n = int(finite.size)
    mean_errors, std_errors = _errors(spec, finite, sample[kept])
    distance = _distance(spec, finite)
    return VariableAnalysis(
        spec=spec,
        n=n,
        mean=float(np.mean(finite)) if n else None,
        std=float(np.std(finite, ddof=1)) if n > 1 else None,
        min=float(finite.min()) if n else None,
        max=float(finite.max()) if n else None,
        outside=int(np.count_nonzero((finite < low) | (finite > high))) + values.size - n,
        histogram=histogram(finite),
        mean_errors=mean_errors,
        std_errors=std_errors,
        distance=distance,
        p_value=None if distance is None or spec.batch else float(kolmogorov(distance * math.sqrt(n))),
    )


def analyse_correlations(spec: ReportSpec, samples: Samples) -> tuple[CorrelationAnalysis, ...]:
    """Return the rank correlations asked for, and the farthest from zero of the others; none below 30 samples."""
    names = [v.name for v in spec.variables if v.std > 0]
    rows = slice(0, _ROWS)
    known = np.all([np.isfinite(samples.values[name][rows]) for name in names], axis=0) if names else np.zeros(0, bool)
    n = int(np.count_nonzero(known))
    if n < _FEWEST or len(names) < 2:
        return ()
    ranks = {name: _ranks(samples.values[name][rows][known]) for name in names}
    asked = {frozenset((a, b)): rank for a, b, rank in spec.correlations}
    found = []
    for a, b in combinations(names, 2):
        scale = float(np.linalg.norm(ranks[a]) * np.linalg.norm(ranks[b]))
        rank, wanted = float(ranks[a] @ ranks[b]) / scale if scale else 0.0, asked.get(frozenset((a, b)), 0.0)
        errors = (rank - wanted) / (1 - wanted**2) * math.sqrt(n - 1)
        found.append(CorrelationAnalysis(a, b, wanted, rank, errors))
    others = sorted((c for c in found if frozenset((c.first, c.second)) not in asked), key=lambda c: -abs(c.errors))
    return (*(c for c in found if frozenset((c.first, c.second)) in asked), *others[:1])


def _errors(spec: VariableSpec, x: Array, sample: NDArray[np.int64]) -> tuple[float | None, float | None]:
    """Return how many standard errors mean and sigma are off, from whole batches where there are any."""
    if spec.std <= 0 or x.size < _FEWEST:
        return None, None
    off, square = x - spec.mean, (x - spec.mean) ** 2 - spec.std**2
    if spec.batch:
        _, group = np.unique(sample // spec.batch, return_inverse=True)
        sizes = np.bincount(group)
        if sizes.size < _FEWEST:
            return None, None
        columns: list[Array] = [np.bincount(group, weights=column).astype(np.float64) for column in (off, square)]
    else:
        columns = [off, square]
    found = []
    for column in columns:
        error = float(np.std(column)) * math.sqrt(column.size)
        found.append(abs(float(np.sum(column))) / error if error > 0 else 0.0)
    return found[0], found[1]


def _distance(spec: VariableSpec, x: Array) -> float | None:
    """Return Kolmogorov's distance at the points where the probability is known; None below 30 values."""
    if not spec.cdf or x.size < _FEWEST or spec.std <= 0:
        return None
    at, p = np.asarray(spec.cdf, np.float64).T
    return float(np.max(np.abs(np.searchsorted(np.sort(x), at, side="right") / x.size - p)))


def _ranks(x: Array) -> Array:
    """Return the ranks around their mean, equal values alike."""
    _, where, count = np.unique(x, return_inverse=True, return_counts=True)
    rank = np.cumsum(count) - 0.5 * (count + 1)
    result: Array = rank[where] - 0.5 * (x.size - 1)
    return result
