"""Is a response normal, and does it matter: sizes of the departure with intervals, not a p-value of n.

With 30,000 values a test rejects what no engineer would mind, with 20 it accepts anything. So the verdict asks how far
the distribution may be from the normal one with the same mean and sigma, given what the sample proves.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import betaincinv, ndtr, ndtri

from reporting.arrays import Array
from reporting.capability.intervals import Interval
from reporting.capability.moments import location_and_shape, series
from reporting.shape.condensed import Condensed, anderson_darling, condense, distance

# A share below any value that is wrong by up to the first is close to normal, from the second on it is not.
CLOSE, FAR = 0.02, 0.05
# Tails this crooked make the normal ppm a poor guess however close the middle is.
SKEWNESS_BAR, KURTOSIS_BAR = 0.5, 1.0
FEWEST_FOR_WORDS = 20
_MOST_FOR_SHAPIRO = 5000
_JUDGED = 20_000


@dataclass(frozen=True)
class Normality:
    """How far a response is from a normal distribution with its mean and sigma.

    Attributes
    ----------
    n : int
        Finite values.
    shapiro_w, shapiro_p : float or None
        Shapiro and Wilk's W and p-value, for 3 to 5,000 values.
    anderson_darling, anderson_darling_p : float or None
        Statistic A^2 and its p-value (D'Agostino, Stephens 1986, mean and sigma estimated).
    distance : float or None
        Largest difference between the share of values below any value and the normal distribution's.
    distance_interval : (float, float) or None
        Between which the true difference lies: `distance` -+ the band of Dvoretzky, Kiefer, Wolfowitz and Massart.
    skewness, kurtosis : float or None
        G1 and G2 (excess).
    skewness_interval, kurtosis_interval : (float, float) or None
        From their influence functions, whatever the distribution.
    verdict : str
        "normal", "close to normal", "not normal", "undecided" or "too few values".
    reason : str
        The verdict in one sentence with its numbers.
    """

    n: int
    shapiro_w: float | None = None
    shapiro_p: float | None = None
    anderson_darling: float | None = None
    anderson_darling_p: float | None = None
    distance: float | None = None
    distance_interval: Interval | None = None
    skewness: float | None = None
    kurtosis: float | None = None
    skewness_interval: Interval | None = None
    kurtosis_interval: Interval | None = None
    verdict: str = "too few values"
    reason: str = "Fewer than two values that differ: no shape."


@dataclass(frozen=True)
class ProbabilityPlot:
    """Points of a normal probability plot: on a straight line where the response is normal.

    Attributes
    ----------
    values : tuple of float
        Ordered values, in their unit; all of a small sample, both tails and a selection of a large one.
    scores : tuple of float
        Normal quantile of each value's median rank ``(i - 0.3) / (n + 0.4)``.
    low, high : tuple of float
        Where the value of that rank lies for a normal response with this mean and sigma, at the confidence (each
        point for itself).
    """

    values: tuple[float, ...]
    scores: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]


def normality(x: ArrayLike, confidence: float = 0.95) -> Normality:
    """Return how far the values are from normal.

    Parameters
    ----------
    x : array_like, shape (n,)
        Values; those that are not finite are left out.
    confidence : float
        Of the intervals.

    Raises
    ------
    ReportError
        `x` is no series of numbers.
    """
    ordered = _ordered(x)
    with np.errstate(over="ignore", invalid="ignore"):
        shape = location_and_shape(ordered)
        n, std = int(ordered.size), shape.get("std", 0.0)
        if not 0 < std < math.inf or n < 3:
            return Normality(n)
        z = (ordered - shape["mean"]) / std
    w, p = _shapiro(z)
    sample = condense(z, _JUDGED)
    cdf = ndtr(sample.values)
    far = distance(sample, cdf)
    band = math.sqrt(math.log(2 / (1 - confidence)) / (2 * n))
    skewness, kurtosis = shape["skewness"], shape.get("kurtosis")
    statistic = anderson_darling(sample, cdf, ndtr(-sample.values))
    skewness_error, kurtosis_error = _errors(sample, float(ndtri(0.5 + confidence / 2)))
    known = Normality(
        n=n,
        shapiro_w=w,
        shapiro_p=p,
        anderson_darling=statistic,
        anderson_darling_p=None if statistic is None or n < 8 else _stephens(statistic, n),
        distance=far,
        distance_interval=(max(far - band, 0.0), min(far + band, 1.0)),
        skewness=skewness,
        kurtosis=kurtosis,
        skewness_interval=(skewness - skewness_error, skewness + skewness_error),
        kurtosis_interval=None if kurtosis is None else (kurtosis - kurtosis_error, kurtosis + kurtosis_error),
    )
    verdict, reason = _verdict(known)
    return Normality(**{**vars(known), "verdict": verdict, "reason": reason})


def probability_plot(x: ArrayLike, most: int = 300, confidence: float = 0.95) -> ProbabilityPlot | None:
    """Return at most `most` points of the probability plot; None where nothing differs.

    Parameters
    ----------
    x : array_like, shape (n,)
        Values; those that are not finite are left out.
    most : int
        Of these, a third are the extremes at each end.
    confidence : float
        Of the band, at each point.
    """
    ordered = _ordered(x)
    with np.errstate(over="ignore", invalid="ignore"):
        shape = location_and_shape(ordered)
    n, std = int(ordered.size), shape.get("std", 0.0)
    if not 0 < std < math.inf:
        return None
    rank = np.arange(1, n + 1)
    if n > most:
        tail = most // 3
        middle = np.linspace(tail, n - 1 - tail, most - 2 * tail).astype(np.int64)
        rank = np.unique(np.concatenate((np.arange(tail), middle, np.arange(n - tail, n)))) + 1
    ends = [
        shape["mean"] + std * ndtri(betaincinv(rank, n + 1 - rank, share))
        for share in (0.5 - confidence / 2, 0.5 + confidence / 2)
    ]
    scores = ndtri((rank - 0.3) / (n + 0.4))
    columns = (ordered[rank - 1], scores, *ends)
    return ProbabilityPlot(*(tuple(column.tolist()) for column in columns))


def _ordered(x: ArrayLike) -> Array:
    values = series(x)
    return np.sort(values[np.isfinite(values)])


def _shapiro(z: Array) -> tuple[float | None, float | None]:
    """Return W and p, up to the number of values for which Royston's approximation holds."""
    if z.size > _MOST_FOR_SHAPIRO:
        return None, None
    from scipy.stats import shapiro  # a second of import that `import reporting` need not pay

    found = shapiro(z)
    return float(found.statistic), float(found.pvalue)


def _stephens(statistic: float, n: int) -> float:
    """Return the p-value of A^2 with mean and sigma estimated (D'Agostino, Stephens 1986, table 4.9)."""
    a = statistic * (1 + 0.75 / n + 2.25 / n**2)
    if a >= 0.6:
        return min(math.exp(1.2937 - 5.709 * a + 0.0186 * a * a), 1.0) if a < 13 else 0.0
    if a > 0.34:
        return math.exp(0.9177 - 4.279 * a - 1.38 * a * a)
    if a > 0.2:
        return 1 - math.exp(-8.318 + 42.796 * a - 59.938 * a * a)
    return 1 - math.exp(-13.436 + 101.14 * a - 223.73 * a * a)


def _errors(sample: Condensed, quantile: float) -> tuple[float, float]:
    """Return the half widths of skewness and kurtosis from the spread of their influence functions."""
    z = sample.values
    g1, b2 = sample.mean(z**3), sample.mean(z**4)
    of_skewness = z**3 - 3 * z - 1.5 * g1 * (z * z - 1) - g1
    of_kurtosis = z**4 - 4 * g1 * z - 2 * b2 * (z * z - 1) - b2
    spreads = (math.sqrt(sample.mean(each * each) / sample.n) for each in (of_skewness, of_kurtosis))
    skewness, kurtosis = (quantile * spread for spread in spreads)
    return skewness, kurtosis


def _verdict(known: Normality) -> tuple[str, str]:
    """Return the word and the sentence: what the sample proves about the size of the departure."""
    assert known.distance_interval is not None
    assert known.skewness is not None
    low, high = known.distance_interval
    crooked = abs(known.skewness) > SKEWNESS_BAR or abs(known.kurtosis or 0.0) > KURTOSIS_BAR
    found = f"shares below a value differ by at most {100 * (known.distance or 0):.2g} % of all values, and the band "
    found += f"of {known.n} values allows {100 * low:.2g} to {100 * high:.2g} %"
    shape = f"skewness {known.skewness:.2f}, excess kurtosis {known.kurtosis or 0:.2f}"
    if known.n < FEWEST_FOR_WORDS:
        return "too few values", f"Too few values for a word on the shape: {found}; {shape}."
    if low > FAR or (low > CLOSE and crooked):
        return "not normal", f"Not normal: {found}; {shape}."
    if crooked:
        if _proven(known):
            return "not normal", f"Not normal in the tails: {shape}; {found}."
        return "undecided", f"The tails look crooked, which {known.n} values do not prove: {shape}; {found}."
    if high <= CLOSE:
        return "normal", f"Normal for every purpose of this report: {found}; {shape}."
    if high <= FAR or (known.distance or 0) <= CLOSE:
        return "close to normal", f"Close to normal: {found}; {shape}."
    return "undecided", f"Neither normal nor not, for lack of values: {found}; {shape}."


def _proven(known: Normality) -> bool:
    """Return whether skewness or kurtosis is beyond its bar at the confidence."""
    for interval, bar in ((known.skewness_interval, SKEWNESS_BAR), (known.kurtosis_interval, KURTOSIS_BAR)):
        if interval is not None and (interval[0] > bar or interval[1] < -bar):
            return True
    return False
