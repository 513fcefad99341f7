"""Weights that turn a sample of one distribution into a sample of another, whether they are reliable, and intervals.

``w_i = p_new(x_i) / p_old(x_i)``, normalised (self-normalised importance sampling). The largest weights are replaced by
quantiles of the generalized Pareto distribution fitted to them (Pareto smoothing: Vehtari, Simpson, Gelman, Yao,
Gabry, JMLR 25(72), 2024). Its shape k measures how heavy the tail of weights is; above 0.5 their variance is infinite.

A refusal must not depend on whether the samples happen to contain the heavy tail: samples that miss it would pass, and
their answers would be wrong. The fitted shape has a standard deviation of 0.18 with 500 samples; the mean logarithmic
excess of the largest fifth of the weights (Hill 1975) has one of 0.03, but is too large for a tail that is not a
Pareto tail. Weights are therefore refused above ``HILL_BAR`` if the fitted shape exceeds ``CLEAR_TAIL`` too, and in any
case if the fitted shape exceeds ``min(0.6, 1 - 1 / log10 n)``.

Intervals of weighted means and shares allow for unobserved samples of large weight.
A few samples of large weight dominate a weighted mean, and such samples that were not drawn are missing in it. Every
interval therefore includes one more sample as influential as the most influential one (as Fay and Feuer 1997 do for
shares). Its width is that of Student's t with the degrees of freedom of the variance of the contributions
(Satterthwaite), and its ends are corrected for the skewness of the contributions by the monotone cubic transformation
of Hall (1992).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import betaincinv, stdtrit

from reporting.arrays import Array, pieces, random_rows, sums
from reporting.capability.intervals import Interval
from reporting.errors import ReportError
from reporting.shape import pareto

# The skewness of samples is smaller than that of their distribution. With this factor 95 % intervals of mean, sigma and
# Cpk covered 90 to 100 % in campaigns of 500 and 5,000 samples with one sigma multiplied by 0.5 to 1.3; with the factor
# 1, 79 to 99 %.
UNSEEN_SKEWNESS = 1.5
_LEAST_FREEDOM = 2.0

LotLabels = NDArray[np.generic]


def by_lot(terms: Array, lots: LotLabels | None) -> Array:
    """Return independent terms: the terms of one lot share a shift and are added."""
    if lots is None:
        return terms
    _, group = np.unique(lots, return_inverse=True)
    return np.asarray(np.bincount(group, weights=terms), np.float64)


@dataclass(frozen=True)
class Contributions:
    """Sums over the contributions of each independent sample, or lot, to the error of an estimate."""

    count: int
    squares: float
    most: float  # the one with the largest size, as are the powers in units of the root of `squares`
    third: float
    fourth: float


def contributions(count: int, terms: Callable[[slice], Array]) -> Contributions:
    """Return the sums over so many terms, which are weight times influence function, given by a range of rows."""
    squares = sum(float(np.sum(terms(rows) ** 2)) for rows in pieces(count))
    most = third = fourth = 0.0
    for rows in pieces(count) if 0 < squares < math.inf else ():
        scaled = terms(rows) / math.sqrt(squares)
        ends = float(scaled.max()), float(scaled.min())
        most = max(most, *ends, key=abs)
        squared = scaled * scaled
        third += float(np.sum(squared * scaled))
        fourth += float(np.sum(squared**2))
    return Contributions(count, squares, most, third, fourth)


def variance_of_sum(of: Contributions) -> float:
    """Return the variance of the sum of independent terms whose expectations add up to zero; infinite for one term."""
    return math.inf if of.count < 2 else of.count / (of.count - 1) * of.squares


def mean_interval(value: float, of: Contributions, confidence: float) -> Interval:
    """Return the two-sided interval of an estimate from its influence function."""
    variance, most = variance_of_sum(of), of.most
    if variance == 0:
        return value, value
    if not math.isfinite(variance):
        return -math.inf, math.inf
    second, third, fourth = 1 + most**2, of.third + most**3, of.fourth + most**4
    spread_of_second = fourth - second**2 / (of.count + 1)
    freedom = 2 * second**2 / spread_of_second if spread_of_second > 0 else float(of.count)
    t = float(stdtrit(min(max(freedom, _LEAST_FREEDOM), of.count - 1), 0.5 + confidence / 2))
    skewness = UNSEEN_SKEWNESS * third / second**1.5
    error = math.sqrt(variance * second)
    return value - error * _hall(t, skewness), value - error * _hall(-t, skewness)


def share_interval(is_out: NDArray[np.bool_], weight: Array, lots: LotLabels | None, confidence: float) -> Interval:
    """Return the two-sided interval of a weighted share; the weights sum to 1."""
    # With equal weights it is the interval of Clopper and Pearson. If no sample is out, it is their interval for a
    # number of samples of 1 divided by the largest weight.
    upper = 0.5 + confidence / 2
    share = min(float(np.sum(weight[is_out])), 1.0)
    variance = float(np.sum(weight[is_out] ** 2))
    largest = float(weight.max())
    if lots is not None:
        weights, counted = by_lot(weight, lots), by_lot(np.where(is_out, weight, 0.0), lots)
        if counted.size < 2:
            return 0.0, 1.0
        largest = float(weights.max())
        widened = float(stdtrit(counted.size - 1, upper) / stdtrit(weight.size - 1, upper)) ** 2
        variance = max(variance, float(np.sum(counted**2))) * widened
    low = 0.0 if share <= 0 else _beta(share, variance, 1 - upper)
    return low, _beta(share + largest, variance + largest**2, upper)


def _beta(share: float, variance: float, p: float) -> float:
    """Return a quantile of the beta distribution for a share counted with this variance."""
    if share >= 1 or variance == 0:  # squares of tiny weights underflow, and the share is zero
        return min(math.floor(share), 1.0)
    count = share**2 / variance
    return float(betaincinv(count, share / variance + 1 - count, p))


def _hall(x: float, skewness: float) -> float:
    """Return the quantile of a studentised mean, corrected for the skewness of the sum."""
    if abs(skewness) < 1e-9:
        return x
    return float((np.cbrt(1 + skewness * (x - skewness / 6)) - 1) / (skewness / 3))


# Weights with a smaller effective sample size, or with a larger single weight, do not determine a sigma; nor do samples
# that are equivalent to fewer new runs, by the distributions alone.
LEAST_EFFECTIVE = 100.0
LARGEST_SHARE = 0.05
LEAST_WORTH = 30.0
PARETO_BAR, HILL_BAR, CLEAR_TAIL = 0.6, 0.4, 0.3
# A smaller probability outside the range of the old distribution changes no share by more than 1 ppm.
MOST_OUTSIDE = 1e-6
_LEAST_TAIL = 5  # fewest weights for the fit of a tail
_NO_TAIL = -math.inf  # shape if weights are equal or too few
_HILL_SHARE = 0.2  # of the weights


@dataclass(frozen=True)
class Change:
    """The effect of a changed distribution on the density of each sample."""

    # ``log p_new(x_i) - log p_old(x_i)`` of each sample, shape (n,), or of each sample and variable, shape (n, k);
    # minus infinity where the new density is zero. A constant offset has no effect.
    log_ratio: ArrayLike
    outside: float = 0.0  # probability of new values outside the range of the old distribution
    spread: float | None = None  # ratio of the new to the old sigma of the changed variable; for advice
    limit: str = ""  # why `spread` is closer to 1 than requested; empty if it is as requested
    settings: tuple[str, ...] = ()  # of the campaign file for this change, each ``VARIABLE.KEY=VALUE``
    written: tuple[str, ...] = ()  # the same, rounded to the digits of a drawing
    # Number of new runs that one sample is equivalent to for the sigma of the changed variable itself, by the two
    # distributions alone; 1 if unknown.
    worth: float = 1.0
    # What the new distributions themselves may be off by, shape (n, k): see `EstimatedDistribution`; None if they are
    # exact.
    doubt: Array | None = None


@dataclass(frozen=True)
class EstimatedDistribution:
    """How well measured parts tell mean and sigma of the distribution that was fitted to them.

    A statistic that is the mean of g(x) then has the error ``E[g b] a e``: b are the standardised value z and z² - 1, e
    two independent standard normal numbers, and ``a a'`` is the covariance of the coefficients. For a normal
    distribution that is the delta method on its maximum likelihood; for others it leaves out what else their shape may
    be.
    """

    mean: float
    std: float
    root: Array  # a, shape (2, 2)

    def at(self, x: Array) -> Array:
        """Return ``b a`` at values of the variable (n,), shape (n, 2)."""
        return np.asarray(_powers((x - self.mean) / self.std) @ self.root)


def _powers(z: Array) -> Array:
    return np.column_stack([z, z * z - 1])


def estimated_distribution(
    moments: tuple[float, float], quantiles: Array, parts: Array, lots: LotLabels | None, confidence: float = 0.95
) -> EstimatedDistribution:
    """Return how well parts (m,) tell a distribution with these moments, and of the shape of these quantiles (n,)."""
    mean, std = moments
    expected = _powers((quantiles - quantiles.mean()) / quantiles.std())
    gram = expected.T @ expected / len(expected)
    z = (parts - parts.mean()) / parts.std()
    if lots is None:
        count, covariance = parts.size, gram / (parts.size - 1)
    else:
        sums = np.column_stack([by_lot(column, lots) for column in _powers(z).T])
        count = len(sums)
        covariance = sums.T @ sums / parts.size**2 * count / (count - 1)
    upper = 0.5 + confidence / 2
    wide = float(stdtrit(count - 1, upper) / stdtrit(math.inf, upper))
    inverse = np.linalg.pinv(gram)
    values, vectors = np.linalg.eigh(inverse @ covariance @ inverse)
    return EstimatedDistribution(mean, std, wide * vectors * np.sqrt(np.maximum(values, 0.0)))


def widened(value: float, interval: Interval, error: float) -> Interval:
    """Return an interval with the half width of another error, which is independent, added to both sides."""
    low, high = interval
    return value - math.hypot(value - low, error), value + math.hypot(high - value, error)


@dataclass(frozen=True)
class Weights:
    """Normalised weights and their diagnostics."""

    weight: Array  # smoothed, shape (n,); the sum is 1
    effective: float  # Kish's sample size, ``1 / sum(w^2)``
    largest: float  # weight before smoothing
    pareto_k: float | None  # shape of the tail of the weights; None if they are equal or too few
    pareto_k_bar: float  # largest accepted shape
    outside: float  # probability of new values outside the range of the old distribution
    refusal: str  # why the weights cannot be used; empty if they can
    doubt: Array | None = None  # of the change


def weights(change: Change) -> Weights:
    """Return the weights of the samples under a change."""
    # ReportError: a log ratio is NaN or plus infinity (the old density is never zero at a sample), or `outside` is not
    # a probability.
    ratio = np.asarray(change.log_ratio, np.float64)
    total = ratio.sum(axis=1) if ratio.ndim == 2 else ratio
    if total.ndim != 1 or np.any(np.isnan(total)) or np.any(total == np.inf):
        raise ReportError(
            f"log ratios of shape {ratio.shape} with NaN or infinity: a finite number a sample (and variable) is "
            "needed, minus infinity where the new density is zero; the old density is not zero at its own samples"
        )
    if not 0 <= change.outside <= 1:
        raise ReportError(f"outside = {change.outside}: a probability between 0 and 1 is needed")
    n = total.size
    bar = min(PARETO_BAR, 1 - 1 / math.log10(n)) if n > 10 else 0.0
    if n == 0 or not np.any(total > -np.inf):
        return Weights(np.zeros(n), 0.0, 1.0, None, bar, change.outside, _refusal(0.0, 1.0, None, bar, change.outside))
    if change.doubt is not None and len(change.doubt) != n:
        raise ReportError(f"doubt of {len(change.doubt)} samples and {n} log ratios; give both of the same samples")
    # A common factor has no effect, and none of these weights overflows.
    raw = total - total.max()
    np.exp(raw, out=raw)
    largest = float(raw.max() / raw.sum())
    weight, k = pareto_smoothed(raw)
    body = _heavy_body(raw, k)
    del raw  # of millions: what is not needed again makes room
    weight /= weight.sum()
    effective = 1 / sums(weight, lambda piece: (piece * piece,))[0]
    finite_k = k if math.isfinite(k) else None
    refusal = _refusal(effective, largest, finite_k, bar, change.outside) or _too_little(n, change.worth)
    refusal = refusal or body
    return Weights(weight, effective, largest, finite_k, bar, change.outside, refusal, change.doubt)


def pareto_smoothed(raw: Array) -> tuple[Array, float]:
    """Return the weights with a smoothed tail, and the shape of the tail; minus infinity if there is none to fit."""
    # The tail has ``min(n / 5, 3 sqrt(n))`` weights; no smoothed weight exceeds the largest raw one.
    count = _tail_size(raw.size)
    if count < _LEAST_TAIL:
        return raw, _NO_TAIL
    order = np.argpartition(raw, raw.size - count - 1)[raw.size - count - 1 :].copy()
    cut, tail = float(raw[order[0]]), order[1:]
    tail = tail[np.argsort(raw[tail], kind="stable")]
    found = _fitted_tail(raw[tail], cut)
    if found is None:
        return raw, _NO_TAIL
    (k, scale), smooth = found, raw.copy()
    smooth[tail] = np.minimum(cut + pareto.quantiles(k, scale, (np.arange(count) + 0.5) / count), raw[tail[-1]])
    return smooth, k


def tail_shape(n: int, values: Callable[[Any], Array]) -> float:
    """Return the shape of the tail that `pareto_smoothed` fits to n values, which are given by some of their rows."""
    count = _tail_size(n)
    if count < _LEAST_TAIL:
        return _NO_TAIL
    # One more of the largest of some values than the tail has: none of the tail of all values is smaller than the last.
    some = values(random_rows(n))
    least = np.partition(some, some.size - count - 1)[some.size - count - 1]
    top = np.sort(np.concatenate([part[part >= least] for part in map(values, pieces(n))]))[-count - 1 :]
    found = _fitted_tail(top[1:], float(top[0]))
    return _NO_TAIL if found is None else found[0]


def _tail_size(n: int) -> int:
    return math.ceil(min(0.2 * n, 3 * math.sqrt(n)))


def _fitted_tail(tail: Array, cut: float) -> tuple[float, float] | None:
    """Return shape and scale of a tail in ascending order beyond a value; None if there is nothing to fit."""
    beyond = tail - cut
    return None if beyond[-1] <= 1e-12 * tail[-1] or beyond[0] <= 0 else pareto.posterior_mean_fit(beyond)


def _refusal(effective: float, largest: float, k: float | None, bar: float, outside: float) -> str:
    """Return why the weights cannot be used; empty if they can."""
    if outside > MOST_OUTSIDE:
        return (
            f"{100 * outside:.3g} % of the new values lie where the campaign has no samples: "
            "the response there is unknown"
        )
    if effective < LEAST_EFFECTIVE:
        return (
            f"the samples are worth {effective:.0f} samples of the new distribution; {LEAST_EFFECTIVE:.0f} are needed"
        )
    if largest > LARGEST_SHARE:
        return (
            f"one sample would carry {100 * largest:.0f} % of the weight; allowed: at most {100 * LARGEST_SHARE:.0f} %"
        )
    if k is not None and k > bar:
        return f"the distribution of the weights has too heavy a tail, Pareto k = {k:.2f} above {bar:.2f}"
    return ""


def _too_little(n: int, worth: float) -> str:
    """Return why the weights cannot be used, judged by the distributions themselves; empty if they can."""
    # Samples cannot reveal this: if the variance of the weighted squares is infinite, samples that miss the tail look
    # well behaved, and their answers are wrong.
    if n * worth >= LEAST_WORTH:
        return ""
    return (
        f"for the new sigma of a changed variable itself the samples are worth {n * worth:.0f} new runs; "
        f"{LEAST_WORTH:.0f} are needed"
    )


def _heavy_body(raw: Array, k: float) -> str:
    """Return why the weights cannot be used, judged by the tail of their upper fifth; empty if they can."""
    # The mean logarithmic excess of the largest fifth over the next smaller one; 0 if equal.
    if not k > CLEAR_TAIL:
        return ""
    count = int(_HILL_SHARE * raw.size)
    top = np.partition(raw, raw.size - count - 1)[raw.size - count - 1 :]
    cut = float(top.min())
    hill = float(np.sum(np.log(top / cut))) / count if count and cut > 0 else 0.0
    if hill > HILL_BAR:
        return (
            f"the largest fifth of the weights has too heavy a tail, with the shape {hill:.2f} above {HILL_BAR:.2f} "
            f"(Pareto k = {k:.2f})"
        )
    return ""
