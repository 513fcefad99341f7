"""Departure of a response from normality, judged by its size and not by a p-value.

With 30,000 values a test rejects departures without practical importance; with 20 values it accepts any distribution.
The verdict is therefore based on the interval of the distance from the normal distribution with equal mean and sigma.

The tails are judged by their weights, and whether chance explains the difference. The weight of a tail is the fourth
moment of its side, ``mean(z^4)`` with 0 for values of the other side, relative to 1.5, that of a normal distribution.
It detects heavy tails long before a count of distant values does: of 500 values of Student's t with 5 degrees of
freedom hardly two more lie beyond three sigma than of 500 normal values.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import betaincinv, ndtr, ndtri

from reporting.capability.intervals import Interval
from reporting.shape.sorted_sample import (
    BinnedSample,
    SortedSample,
    anderson_darling,
    bin_sample,
    distance,
    sorted_sample,
)

NORMAL_WEIGHT = 1.5  # of a tail
FEWEST_FOR_TAILS = 50
# A tail is called heavier or lighter up to this p-value; whether a response departs at all is decided before, for all
# responses together.
DIRECTION_P = 0.01
# A response is normal up to the first distance, and not normal above the second.
CLOSE, FAR = 0.02, 0.05
# If the interval of the distance reaches beyond this, a small distance may be due to chance.
_OPEN = 0.10
# Beyond these values the normal ppm is a poor estimate, however close the middle of the distribution is.
SKEWNESS_BAR, KURTOSIS_BAR = 0.5, 1.0
FEWEST_FOR_WORDS = 20
# A smaller p-value is not due to chance: the response is proven not to be normal.
PROVEN_P = 0.001
_MOST_FOR_SHAPIRO = 5000
_JUDGED = 20_000
_TAILS = {"below": "lower", "above": "upper"}
# With six normal responses of 30 to 5,000 values, one of them is called not normal in 4 to 5 % of campaigns (measured).
DEPARTURE_P = 0.04


@dataclass(frozen=True)
class TailWeight:
    """One tail of a response compared with that of a normal distribution with its mean and sigma."""

    side: str  # "below" or "above" the mean
    # Relative to a normal tail: 1 for a normal distribution, 2 for Student's t with 6 degrees of freedom, 0.6 for a
    # uniform distribution.
    weight: float
    p: float  # two-sided probability of a weight at least as far from 1 in a sample of normal values
    word: str  # "heavier", "lighter" or "like normal"

    @property
    def words(self) -> str:
        """Which tail is heavier or lighter; empty for one like normal."""
        return "" if self.word == "like normal" else f"{_TAILS[self.side]} tail {self.word}"


@dataclass(frozen=True)
class Normality:
    """Departure of a response from the normal distribution with its mean and sigma."""

    n: int  # finite values
    shapiro_w: float | None = None  # Shapiro and Wilk's, for 3 to 5,000 values
    shapiro_p: float | None = None
    anderson_darling: float | None = None  # statistic A^2
    # mean and sigma estimated (D'Agostino, Stephens 1986); None below 8 values and with lots
    anderson_darling_p: float | None = None
    distance: float | None = None  # Kolmogorov's: the largest difference from the cumulative normal distribution
    # of the true distance, from the band of Dvoretzky, Kiefer, Wolfowitz, Massart (1990)
    distance_interval: Interval | None = None
    skewness: float | None = None  # G1
    kurtosis: float | None = None  # G2, excess
    # from the influence function, valid for any distribution; so is that of the kurtosis
    skewness_interval: Interval | None = None
    kurtosis_interval: Interval | None = None
    # whether the lower and the upper tail are heavier or lighter than normal; empty below 50 values
    tails: tuple[TailWeight, ...] = ()
    # Probability, for a sample of normal values, of a departure at least as clear as the clearest one of A^2 and the
    # two tails (Bonferroni); None below 8 values.
    p: float | None = None
    verdict: str = "too few values"  # "normal", "close to normal", "not normal", "undecided" or "too few values"
    # the verdict in one sentence, with its numbers
    reason: str = "Fewer than two different values, so there is no shape."


@dataclass(frozen=True)
class ProbabilityPlot:
    """Points of a normal probability plot: on a straight line if the response is normal."""

    # ordered, in their unit: all of a small sample; both tails and a selection of a large one
    values: tuple[float, ...]
    scores: tuple[float, ...]  # normal quantile of each value's median rank ``(i - 0.3) / (n + 0.4)``
    low: tuple[float, ...]  # pointwise band for the value of this rank of a normal response with this mean and sigma
    high: tuple[float, ...]


def normality(x: ArrayLike | SortedSample, confidence: float = 0.95, worth: float | None = None) -> Normality:
    """Return the departure of finite values from normality; `worth` is their effective number if in lots."""
    given = sorted_sample(x)
    ordered, shape = given.values, given.location
    n, std = int(ordered.size), shape.get("std", 0.0)
    if not 0 < std < math.inf or n < 3:
        return Normality(n)
    w = p = None
    if n <= _MOST_FOR_SHAPIRO:  # above, Royston's (1995) approximation is not valid
        from scipy.stats import shapiro  # takes 1 s to import, which `import reporting` avoids

        w, p = map(float, shapiro((ordered - shape["mean"]) / std))
    sample = bin_sample(ordered, _JUDGED, shape["mean"], std)
    cdf = ndtr(sample.values)
    far = distance(sample, cdf)
    # With Massart's constant the band holds for every n and every distribution.
    band = math.sqrt(math.log(2 / (1 - confidence)) / (2 * (worth or n)))
    skewness, kurtosis = shape["skewness"], shape.get("kurtosis")
    statistic = anderson_darling(sample, cdf, ndtr(-sample.values))
    skewness_error, kurtosis_error = _errors(sample, float(ndtri(0.5 + confidence / 2)))
    p_value = None if statistic is None or n < 8 or worth is not None else _stephens(statistic, n)
    tails = tail_weights(sample, worth or n)
    several = [*([] if p_value is None else [p_value]), *(tail.p for tail in tails)]
    measures = Normality(
        n=n,
        shapiro_w=w,
        shapiro_p=p,
        anderson_darling=statistic,
        anderson_darling_p=p_value,
        distance=far,
        distance_interval=(max(far - band, 0.0), min(far + band, 1.0)),
        skewness=skewness,
        kurtosis=kurtosis,
        skewness_interval=(skewness - skewness_error, skewness + skewness_error),
        kurtosis_interval=None if kurtosis is None else (kurtosis - kurtosis_error, kurtosis + kurtosis_error),
        tails=tails,
        p=min(1.0, len(several) * min(several)) if several else None,
    )
    verdict, reason = _verdict(measures)
    return replace(measures, verdict=verdict, reason=reason)


def probability_plot(x: ArrayLike | SortedSample, most: int = 300, confidence: float = 0.95) -> ProbabilityPlot | None:
    """Return at most `most` points of the probability plot, a third of them extremes at each end; None if constant."""
    given = sorted_sample(x)
    ordered, shape = given.values, given.location
    n, std = int(ordered.size), shape.get("std", 0.0)
    if not 0 < std < math.inf:
        return None
    rank = np.arange(1, min(n, most) + 1)
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


def tail_weights(sample: BinnedSample, worth: float) -> tuple[TailWeight, ...]:
    """Return the weights of both tails of standardised values (divisor n - 1); empty below 50 independent values.

    In samples of normal values ``weight^(-1/2)`` is approximately normal: simulated with 3,000 to 60,000 samples of 50
    to 20,000 values, its mean and sigma follow the formulas below, and p-values of 1 in 100 are correct to a third.
    """
    if worth < FEWEST_FOR_TAILS:
        return ()
    return tuple(_tail(sample, worth, side, sign) for side, sign in (("below", -1.0), ("above", 1.0)))


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


def _errors(sample: BinnedSample, quantile: float) -> tuple[float, float]:
    """Return the half widths of the intervals of skewness and kurtosis, from their influence functions."""
    z = sample.values
    g1, b2 = sample.mean(z**3), sample.mean(z**4)
    of_skewness = z**3 - 3 * z - 1.5 * g1 * (z * z - 1) - g1
    of_kurtosis = z**4 - 4 * g1 * z - 2 * b2 * (z * z - 1) - b2
    spreads = (math.sqrt(sample.mean(each * each) / sample.n) for each in (of_skewness, of_kurtosis))
    skewness, kurtosis = (quantile * spread for spread in spreads)
    return skewness, kurtosis


def _tail(sample: BinnedSample, worth: float, side: str, sign: float) -> TailWeight:
    z = sign * sample.values
    moment = sample.mean(np.where(z > 0, z, 0.0) ** 4)
    if moment == 0:
        return TailWeight(side, 0.0, 0.0, "lighter")
    expected = NORMAL_WEIGHT**-0.5 + 4.4 / worth
    error = 1.272 / math.sqrt(worth) * (1 - 0.55 / math.sqrt(worth))
    p = 2 * float(ndtr(-abs(moment**-0.5 - expected) / error))
    word = "like normal" if p > DIRECTION_P else "heavier" if moment**-0.5 < expected else "lighter"
    return TailWeight(side, moment / NORMAL_WEIGHT, p, word)


def _verdict(measures: Normality) -> tuple[str, str]:
    assert measures.distance is not None
    assert measures.distance_interval is not None
    assert measures.skewness is not None
    (low, high), kurtosis = measures.distance_interval, measures.kurtosis or 0.0
    heavy = abs(measures.skewness) > SKEWNESS_BAR or abs(kurtosis) > KURTOSIS_BAR
    distance = (
        f"cumulative shares differ from those of a normal distribution by at most {100 * measures.distance:.2g} % "
        f"(with {measures.n} values, between {100 * low:.2g} and {100 * high:.2g} %)"
    )
    tails = "".join(f", {tail.words} than normal ({tail.weight:.2g} times)" for tail in measures.tails if tail.words)
    shape = f"skewness {measures.skewness:.2f}, excess kurtosis {kurtosis:.2f}{tails}"
    if measures.n < FEWEST_FOR_WORDS:
        return "too few values", f"Too few values for a verdict on the shape: {distance}; {shape}."
    proven = any(p is not None and p < PROVEN_P for p in (measures.p, measures.anderson_darling_p))
    if low > FAR or (low > CLOSE and heavy):
        return "not normal", f"Not normal: {distance}; {shape}."
    if heavy:
        intervals = ((measures.skewness_interval, SKEWNESS_BAR), (measures.kurtosis_interval, KURTOSIS_BAR))
        if proven or any(interval and (interval[0] > bar or interval[1] < -bar) for interval, bar in intervals):
            return "not normal", f"Not normal in the tails: {shape}; {distance}."
        what = f"Perhaps not normal in the tails, but {measures.n} values do not prove it"
        return "undecided", f"{what}: {shape}; {distance}."
    if high <= CLOSE:
        return "normal", f"Normal to within {100 * high:.2g} % of the values: {distance}; {shape}."
    # At 95 % the band alone is 1.36 / sqrt(n): below 740 values it ends beyond `FAR` whatever the distance.
    if high <= FAR or (measures.distance <= CLOSE and high <= _OPEN and not proven):
        return "close to normal", f"Close to normal: {distance}; {shape}."
    if proven:
        return "not normal", f"Not normal, but it is not clear by how much: {distance}; {shape}."
    return "undecided", f"Undecided, more samples are needed: {distance}; {shape}."


def departs(shape: Normality, tests: int, level: float = DEPARTURE_P) -> bool:
    """Return whether values are not normal, beyond what chance produces among `tests` responses (Bonferroni)."""
    return shape.verdict == "not normal" or (shape.p is not None and tests * shape.p < level)
