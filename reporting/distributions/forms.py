"""Distributions in closed form: all that is known of each, by its usual parameters in the unit of the values.

A fit evaluates them a few thousand times with different parameters, and `scipy.stats` takes fifty times as long,
because it builds and checks an object for each set of parameters. Parameters are numbers, or arrays of shape (b, 1);
then each function of m values returns the results of b distributions at once, shape (b, m).

Samples are drawn from them too: a quantile or a probability depends, bit for bit, on its own argument alone and not on
how many others are computed with it, because a row must not depend on its batch. ``scipy.stats`` has other bits in some
tails, and every worker would pay for its import (half a second, 50 MB).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from scipy import special
from scipy.special import exp2, expm1, log1p, ndtr, ndtri, xlog1py, xlogy

from reporting.arrays import Array

# Functions whose results do not depend, bit for bit, on the length of the array.
#
# They use scipy's special functions, which treat every element alike. NumPy's own ``exp``, ``log`` and ``power`` may
# use other instructions for the last elements of an array than for the first ones.

LOG2_E = 1.4426950408889634


def exp(x: Any) -> Array:
    """Return e to the power ``x``; same shape."""
    return np.asarray(exp2(np.multiply(LOG2_E, x)), dtype=np.float64)


def log(x: Any) -> Array:
    """Return the natural logarithm of ``x`` >= 0, minus infinity at 0; same shape."""
    return np.asarray(xlogy(1.0, x), dtype=np.float64)


def power(x: Any, exponent: Any) -> Array:
    """Return ``x`` >= 0 to the power of a positive exponent; the shape of both together."""
    return exp(exponent * log(x))


Function = Callable[[Array], Array]
Parameter = float | Array
Moments = tuple[float, float]  # mean and standard deviation

_HALF_LOG_2PI = 0.9189385332046728
_HALVINGS = 80
_STEPS, _LAST_DIGITS = 100, 1e-16
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)
_BLOCK = 256  # values that are computed together
LARGE = 1e4  # shape of a Weibull distribution
ZETA = (1.6449340668482264, 1.2020569031595942, 1.0823232337111382)  # zeta(2), zeta(3), zeta(4)


def _unknown() -> Moments:
    """Moments of a distribution that is fitted only."""
    raise NotImplementedError


@dataclass(frozen=True)
class ClosedForm:
    """A distribution, as functions of arrays."""

    logpdf: Function  # logarithm of the density at a value; minus infinity, or not a number, where there is no value
    cdf: Function  # probability of values up to a value
    sf: Function  # probability of values above a value, with all its digits
    ppf: Function  # value with a probability below it
    isf: Function  # value with a probability above it
    support: tuple[Any, Any] = (-math.inf, math.inf)  # both ends of the values
    moments: Callable[[], Moments] = field(default=_unknown)


def normal_after(
    score: Function,
    log_slope: Function,
    inverse: Function,
    support: tuple[Any, Any] = (-math.inf, math.inf),
    moments: Callable[[], Moments] = _unknown,
) -> ClosedForm:
    """Return the distribution of values whose increasing `score` is standard normal.

    `log_slope` is the logarithm of its derivative, `inverse` the value of a score.
    """
    return ClosedForm(
        logpdf=lambda z: log_slope(z) - 0.5 * score(z) ** 2 - _HALF_LOG_2PI,
        cdf=lambda z: ndtr(score(z)),
        sf=lambda z: ndtr(-score(z)),
        ppf=lambda p: inverse(ndtri(p)),
        isf=lambda q: inverse(-ndtri(q)),
        support=support,
        moments=moments,
    )


def normal(mean: Parameter, std: Parameter) -> ClosedForm:
    """Return the normal distribution."""
    slope = -np.log(std)
    return normal_after(
        lambda z: (z - mean) / std,
        lambda z: np.zeros_like(z) + slope,
        lambda s: mean + std * s,
        moments=lambda: (float(mean), float(std)),
    )


def lognormal(low: Parameter, mean: Parameter, std: Parameter) -> ClosedForm:
    """Return the distribution of values whose ``ln(z - low)`` is normal (Johnson's SL)."""

    def moments() -> Moments:
        height = math.exp(mean + 0.5 * std * std)
        return float(low + height), height * math.sqrt(math.expm1(std * std))

    return normal_after(
        lambda z: (log(np.maximum(z - low, 0.0)) - mean) / std,
        lambda z: -np.log(z - low) - np.log(std),
        lambda s: low + exp(mean + std * s),
        (low, math.inf),
        moments,
    )


def johnson_su(gamma: Parameter, delta: Parameter, xi: Parameter, scale: Parameter) -> ClosedForm:
    """Return Johnson's (1949) unbounded distribution: ``gamma + delta asinh((z - xi) / scale)`` is normal."""
    return normal_after(
        lambda z: gamma + delta * np.arcsinh((z - xi) / scale),
        lambda z: np.log(delta / scale) - 0.5 * np.log1p(((z - xi) / scale) ** 2),
        lambda s: xi + scale * np.sinh((s - gamma) / delta),
    )


def johnson_sb(gamma: Parameter, delta: Parameter, low: Parameter, high: Parameter) -> ClosedForm:
    """Return Johnson's (1949) bounded distribution: ``gamma + delta ln((z - low) / (high - z))`` is normal."""
    return normal_after(
        lambda z: gamma + delta * special.logit(np.clip((z - low) / (high - low), 0.0, 1.0)),
        lambda z: np.log(delta * (high - low)) - np.log(z - low) - np.log(high - z),
        lambda s: low + (high - low) * special.expit((s - gamma) / delta),
        (low, high),
    )


def box_cox_normal(power: Parameter, mean: Parameter, std: Parameter) -> ClosedForm:
    """Return the distribution of positive values whose ``(z^power - 1) / power`` is normal (Box, Cox 1964)."""
    return normal_after(
        lambda z: (special.boxcox(np.maximum(z, 0.0), power) - mean) / std,
        lambda z: (power - 1.0) * np.log(z) - np.log(std),
        lambda s: special.inv_boxcox(mean + std * s, power),
    )


def yeo_johnson_normal(power: Parameter, mean: Parameter, std: Parameter) -> ClosedForm:
    """Return the distribution of values that are normal after the power transform of Yeo and Johnson (2000)."""

    def transformed(z: Array) -> Array:
        up, down = special.boxcox1p(np.maximum(z, 0), power), special.boxcox1p(np.maximum(-z, 0), 2 - power)
        return np.asarray(np.where(z >= 0, up, -down))

    def back(y: Array) -> Array:
        up, down = special.inv_boxcox1p(np.maximum(y, 0), power), special.inv_boxcox1p(np.maximum(-y, 0), 2 - power)
        return np.asarray(np.where(y >= 0, up, -down))

    return normal_after(
        lambda z: (transformed(z) - mean) / std,
        lambda z: (power - 1.0) * np.sign(z) * np.log1p(np.abs(z)) - np.log(std),
        lambda s: back(mean + std * s),
    )


def exponential(low: Parameter, scale: Parameter) -> ClosedForm:
    """Return the exponential distribution of values above `low`."""
    return ClosedForm(
        logpdf=lambda z: np.where(z >= low, -(z - low) / scale - np.log(scale), -math.inf),
        cdf=lambda z: -expm1(-np.maximum(z - low, 0.0) / scale),
        sf=lambda z: exp(-np.maximum(z - low, 0.0) / scale),
        ppf=lambda p: low - scale * log1p(-p),
        isf=lambda q: low - scale * log(q),
        support=(low, math.inf),
        moments=lambda: (float(low + scale), float(scale)),
    )


def weibull(low: Parameter, shape: Parameter, scale: Parameter) -> ClosedForm:
    """Return the Weibull distribution, ``P(Z > z) = exp(-((z - low)/scale)^shape)``."""

    def height(z: Array) -> Array:
        return np.maximum(z - low, 0.0) / scale

    def log_density(z: Array) -> Array:
        h = height(z)
        density = xlogy(shape - 1.0, h) - power(h, shape) + np.log(shape / scale)
        return np.where(z >= low, density, -math.inf)

    def moments() -> Moments:
        above = scale * math.exp(math.lgamma(1.0 + 1.0 / shape))
        return float(low + above), float(above) * weibull_variation(float(shape))

    return ClosedForm(
        logpdf=log_density,
        cdf=lambda z: -expm1(-power(height(z), shape)),
        sf=lambda z: exp(-power(height(z), shape)),
        ppf=lambda p: low + scale * power(-log1p(-p), 1.0 / shape),
        isf=lambda q: low + scale * power(-log(q), 1.0 / shape),
        support=(low, math.inf),
        moments=moments,
    )


def weibull_variation(shape: float) -> float:
    """Return the standard deviation divided by the mean of a Weibull distribution whose origin is 0."""
    if shape > LARGE:  # the difference below would lose digits: use the series of log gamma at 1
        x = 1.0 / shape
        return float(np.sqrt(np.expm1(x * x * (ZETA[0] - 2.0 * ZETA[1] * x + 3.5 * ZETA[2] * x * x))))
    return float(np.sqrt(np.expm1(math.lgamma(1.0 + 2.0 / shape) - 2.0 * math.lgamma(1.0 + 1.0 / shape))))


def gamma(low: Parameter, shape: Parameter, scale: Parameter) -> ClosedForm:
    """Return the gamma distribution of values above `low`."""
    constant = -special.gammaln(shape) - np.log(scale)

    def height(z: Array) -> Array:
        return np.maximum(z - low, 0.0) / scale

    def log_density(z: Array) -> Array:
        h = height(z)
        return np.where(z >= low, xlogy(shape - 1.0, h) - h + constant, -math.inf)

    return ClosedForm(
        logpdf=log_density,
        cdf=lambda z: special.gammainc(shape, height(z)),
        sf=lambda z: special.gammaincc(shape, height(z)),
        ppf=lambda p: low + scale * special.gammaincinv(shape, p),
        isf=lambda q: low + scale * special.gammainccinv(shape, q),
        support=(low, math.inf),
        moments=lambda: (float(low + shape * scale), math.sqrt(shape) * float(scale)),
    )


def beta(a: Parameter, b: Parameter, low: Parameter = 0.0, high: Parameter = 1.0) -> ClosedForm:
    """Return the beta distribution between two ends."""
    width = high - low
    constant = -special.betaln(a, b) - np.log(width)

    def log_density(z: Array) -> Array:
        h = np.clip((z - low) / width, 0.0, 1.0)
        density = xlogy(a - 1.0, h) + xlog1py(b - 1.0, -h) + constant
        return np.where((z >= low) & (z <= high), density, -math.inf)

    def moments() -> Moments:
        total = a + b
        return float(low + width * a / total), float(width) * math.sqrt(a * b / (total * total * (total + 1.0)))

    return ClosedForm(
        logpdf=log_density,
        cdf=lambda z: special.betainc(a, b, np.clip((z - low) / width, 0.0, 1.0)),
        sf=lambda z: special.betainc(b, a, np.clip((high - z) / width, 0.0, 1.0)),
        ppf=lambda p: low + width * special.betaincinv(a, b, p),
        isf=lambda q: high - width * special.betaincinv(b, a, q),
        support=(low, high),
        moments=moments,
    )


def uniform(low: float, high: float) -> ClosedForm:
    """Return the uniform distribution."""
    width = high - low
    return ClosedForm(
        logpdf=lambda z: np.where((z >= low) & (z <= high), -np.log(width), -math.inf),
        cdf=lambda z: np.clip((z - low) / width, 0.0, 1.0),
        sf=lambda z: np.clip((high - z) / width, 0.0, 1.0),
        ppf=lambda p: low + p * width,
        isf=lambda q: high - q * width,
        support=(low, high),
        moments=lambda: (0.5 * (low + high), width / math.sqrt(12.0)),
    )


def triangular(low: float, mode: float, high: float) -> ClosedForm:
    """Return the distribution whose density rises in a straight line from `low` to `mode` and falls to `high`."""
    width, rise, fall = high - low, mode - low, high - mode

    def left(z: Array) -> Array:  # area of the triangle between the lower end and z, up to the mode
        distance = np.clip(z - low, 0.0, rise)
        return np.asarray(distance * distance / (width * (rise or 1.0)))

    def right(z: Array) -> Array:
        distance = np.clip(high - z, 0.0, fall)
        return np.asarray(distance * distance / (width * (fall or 1.0)))

    def log_density(z: Array) -> Array:
        # a mode at an end leaves a side without width: nothing lies there, and 1 avoids a division by 0
        rising, falling = (z - low) / (rise or 1.0), (high - z) / (fall or 1.0)
        height = np.where(z < mode, rising, np.where((z == mode) & (fall == 0.0), 1.0, falling))
        return log(np.maximum(height, 0.0) * 2.0 / width)

    def quantile(below: Array, above: Array, rising: Any) -> Array:
        return np.where(rising, low + np.sqrt(below * width * rise), high - np.sqrt(above * width * fall))

    return ClosedForm(
        logpdf=log_density,
        cdf=lambda z: np.where(np.less(z, mode), left(z), 1.0 - right(z)),
        sf=lambda z: np.where(np.less(z, mode), 1.0 - left(z), right(z)),
        ppf=lambda p: quantile(p, 1.0 - p, p * width < rise),
        isf=lambda q: quantile(1.0 - q, q, q * width > fall),
        support=(low, high),
        moments=lambda: ((low + mode + high) / 3.0, math.sqrt((rise**2 + rise * fall + fall**2) / 18.0)),
    )


def folded_normal(mean: Parameter, std: Parameter) -> ClosedForm:
    """Return the distribution of the absolute value of a normal variable; with mean 0, the half-normal distribution."""
    slope = -np.log(std) - _HALF_LOG_2PI

    def cdf(z: Array) -> Array:
        z = np.maximum(z, 0.0)
        return np.asarray(ndtr((z - mean) / std) - ndtr((-z - mean) / std))

    def sf(z: Array) -> Array:
        return np.where(z > 0, ndtr((mean - z) / std) + ndtr((-z - mean) / std), 1.0)

    def quantile(p: Array, rest: Array, under: Callable[[Array], Any]) -> Array:
        return _bisect(under, np.zeros_like(p * mean), abs(mean) + std * np.abs(ndtri(rest / 2)))

    return ClosedForm(
        logpdf=lambda z: slope + np.logaddexp(-0.5 * ((z - mean) / std) ** 2, -0.5 * ((z + mean) / std) ** 2),
        cdf=cdf,
        sf=sf,
        ppf=lambda p: quantile(p, 1 - p, lambda z: cdf(z) < p),
        isf=lambda q: quantile(q, q, lambda z: sf(z) > q),
        support=(0.0, math.inf),
    )


def symmetric(centre: Parameter, scale: Parameter, logpdf: Function, cdf: Function, quantile: Function) -> ClosedForm:
    """Return a distribution that is symmetric about its centre, by functions of the scores (z - centre) / scale."""
    return ClosedForm(
        logpdf=lambda z: logpdf((z - centre) / scale),
        cdf=lambda z: cdf((z - centre) / scale),
        sf=lambda z: cdf((centre - z) / scale),
        ppf=lambda p: centre + scale * quantile(p),
        isf=lambda q: centre - scale * quantile(q),
    )


def logistic(mean: Parameter, scale: Parameter) -> ClosedForm:
    """Return the logistic distribution."""
    slope = np.log(scale)
    return symmetric(mean, scale, lambda u: -u - 2 * np.logaddexp(0.0, -u) - slope, special.expit, special.logit)


def log_logistic(low: Parameter, mean: Parameter, scale: Parameter) -> ClosedForm:
    """Return the distribution of values whose ``ln(z - low)`` is logistic."""
    base = logistic(mean, scale)
    return ClosedForm(
        logpdf=lambda z: base.logpdf(log(np.maximum(z - low, 0.0))) - np.log(z - low),
        cdf=lambda z: base.cdf(log(np.maximum(z - low, 0.0))),
        sf=lambda z: base.sf(log(np.maximum(z - low, 0.0))),
        ppf=lambda p: low + exp(base.ppf(p)),
        isf=lambda q: low + exp(base.isf(q)),
        support=(low, math.inf),
    )


def student_t(mean: Parameter, scale: Parameter, freedom: Parameter) -> ClosedForm:
    """Return Student's t distribution, shifted and scaled."""
    half = (np.asarray(freedom) + 1) / 2
    constant = special.gammaln(half) - special.gammaln(half - 0.5) - 0.5 * np.log(np.pi * freedom) - np.log(scale)
    return symmetric(
        mean,
        scale,
        lambda u: constant - half * np.log1p(u**2 / freedom),
        lambda u: special.stdtr(freedom, u),
        lambda p: special.stdtrit(freedom, p),
    )


def laplace(median: Parameter, scale: Parameter) -> ClosedForm:
    """Return Laplace's distribution: exponential on both sides."""
    slope = np.log(2 * scale)

    def share(u: Array) -> Array:
        half = 0.5 * np.exp(-np.abs(u))
        return np.asarray(np.where(u < 0, half, 1.0 - half))

    def score(p: Array) -> Array:
        return np.where(p < 0.5, np.log(2 * p), -np.log(2 * (1 - p)))

    return symmetric(median, scale, lambda u: -np.abs(u) - slope, share, score)


def largest_extreme(mode: Parameter, scale: Parameter) -> ClosedForm:
    """Return Gumbel's distribution of the largest of many values; mirrored, it is the distribution of the smallest."""

    def log_density(z: Array) -> Array:
        u = (z - mode) / scale
        return np.asarray(-u - np.exp(-u) - np.log(scale))

    return ClosedForm(
        logpdf=log_density,
        cdf=lambda z: np.exp(-np.exp((mode - z) / scale)),
        sf=lambda z: -np.expm1(-np.exp((mode - z) / scale)),
        ppf=lambda p: mode - scale * np.log(-np.log(p)),
        isf=lambda q: mode - scale * np.log(-np.log1p(-q)),
    )


def two_normals(share: Parameter, mean1: Parameter, std1: Parameter, mean2: Parameter, std2: Parameter) -> ClosedForm:
    """Return a mixture of two normal distributions, the first with the probability `share`."""
    one, two = normal(mean1, std1), normal(mean2, std2)
    rest = 1.0 - share

    def cdf(z: Array) -> Array:
        return share * one.cdf(z) + rest * two.cdf(z)

    def sf(z: Array) -> Array:
        return share * one.sf(z) + rest * two.sf(z)

    def between(a: Array, b: Array, under: Callable[[Array], Any]) -> Array:
        return _bisect(under, np.minimum(a, b), np.maximum(a, b))

    return ClosedForm(
        logpdf=lambda z: np.logaddexp(np.log(share) + one.logpdf(z), np.log(rest) + two.logpdf(z)),
        cdf=cdf,
        sf=sf,
        ppf=lambda p: between(one.ppf(p), two.ppf(p), lambda z: cdf(z) < p),
        isf=lambda q: between(one.isf(q), two.isf(q), lambda z: sf(z) > q),
    )


def selective(middle: float, first: float, second: float, reach: float, classes: int) -> ClosedForm:
    """Return the distribution of half the difference of two parts that are sorted into classes and then mated.

    Both are normal with standard deviations ``first`` and ``second``, ``middle`` is half the difference of their means.
    What lies beyond ``reach`` standard deviations is sorted out. The rest of each part is sorted into classes of equal
    width, and class i of the first is mated at random with class i of the second. As classes of one number hold the
    same share of both, nothing is left over.

    In a class the parts are truncated normal and independent. The density of their difference is closed (a normal one
    times the probability of a normal range), its integral a sum over Gauss's nodes.
    """
    edges = np.linspace(-reach, reach, classes + 1)
    a, b = edges[:-1, None], edges[1:, None]  # (classes, 1), in standard deviations
    share = _between(a, b)
    weight = share / share.sum()
    low, high = middle - 0.5 * (first + second) * reach, middle + 0.5 * (first + second) * reach
    # nodes and weights on (0, 1), in panels of at most two standard deviations
    panels = math.ceil(reach / classes)
    node = np.concatenate([(panel + 0.5 * (1.0 + _NODES)) / panels for panel in range(panels)])[:, None]
    gauss = np.tile(0.5 * _WEIGHTS / panels, panels)[:, None]

    def difference(t: Array) -> Array:
        return np.asarray(2.0 * (np.clip(t, low, high) - middle))

    def kinks(y: Array) -> tuple[Array, Array]:
        """Return the second part's scores from which on, and up to which, the first one's limits y."""
        return np.clip((first * a - y) / second, a, b), np.clip((first * b - y) / second, a, b)

    def mixed(t: Array, of_classes: Function) -> Array:
        """Return the sum over the classes of a function of y, (n,), that returns (classes, n), by blocks."""
        y = difference(np.asarray(t, dtype=np.float64))
        blocks = [_sum_first(weight * of_classes(y.ravel()[i : i + _BLOCK])) for i in range(0, y.size, _BLOCK)]
        return np.concatenate([*blocks, np.zeros(0)]).reshape(y.shape)

    def inside(y: Array, inner: Function) -> Array:
        """Return the integral of the second part's density times ``inner`` of the first one's score."""
        below, above = kinks(y)
        z = below[:, None] + (above - below)[:, None] * node
        x = np.clip((y + second * z) / first, a[:, None], b[:, None])
        terms = np.moveaxis(gauss * exp(-0.5 * z * z - _HALF_LOG_2PI) * inner(x), 1, 0)
        return np.asarray((above - below) * _sum_first(terms))

    def cdf_of(y: Array) -> Array:
        within = inside(y, lambda x: _between(a[:, None], x)) / share
        return np.asarray(np.clip((within + _between(kinks(y)[1], b)) / share, 0.0, 1.0))

    def sf_of(y: Array) -> Array:
        within = inside(y, lambda x: _between(x, b[:, None])) / share
        return np.asarray(np.clip((within + _between(a, kinks(y)[0])) / share, 0.0, 1.0))

    def density_of(y: Array) -> Array:
        spread = math.hypot(first, second)
        centre, width = -y * second / spread**2, first / spread
        below, above = kinks(y)
        of_range = _between((below - centre) / width, (above - centre) / width)
        return np.asarray(exp(-0.5 * (y / spread) ** 2 - _HALF_LOG_2PI) / spread * of_range / share**2)

    cdf, sf = partial(mixed, of_classes=cdf_of), partial(mixed, of_classes=sf_of)

    def density(t: Array) -> Array:
        return 2.0 * mixed(t, density_of)

    def moments() -> Moments:
        at_a, at_b = (exp(-0.5 * edge * edge - _HALF_LOG_2PI) for edge in (a, b))
        score = (at_a - at_b) / share
        variance = 1.0 + (a * at_a - b * at_b) / share - score**2
        mean = (first - second) * score
        whole = float((weight * mean).sum())
        square = weight * ((first**2 + second**2) * variance + (mean - whole) ** 2)
        return middle + 0.5 * whole, 0.5 * math.sqrt(float(square.sum()))

    return ClosedForm(
        logpdf=lambda t: np.where((t >= low) & (t <= high), log(density(t)), -math.inf),
        cdf=cdf,
        sf=sf,
        ppf=lambda p: _solve(lambda t, share: cdf(t) - share, density, p, low, high),
        isf=lambda q: _solve(lambda t, share: share - sf(t), density, q, low, high),
        support=(low, high),
        moments=moments,
    )


def _sum_first(terms: Array) -> Array:
    """Return the sum along the first axis, one term after the other: the bits do not depend on the other axes."""
    return np.asarray(np.cumsum(terms, axis=0)[-1])


def _between(a: Array, b: Array) -> Array:
    """Return the probability of a standard normal value between a and b, a <= b, with the digits of its tail."""
    return np.asarray(np.where(a > 0.0, ndtr(-a) - ndtr(-b), ndtr(b) - ndtr(a)))


def _solve(excess: Callable[[Array, Array], Array], slope: Function, p: Array, low: float, high: float) -> Array:
    """Return where the increasing ``excess`` of x and p is 0, between two bounds, for each p.

    Newton's method, and bisection where it leaves the bounds found so far; an element that has converged is left alone,
    so that it does not depend on the others.
    """
    p = np.asarray(p, dtype=np.float64)
    wanted, x = p.ravel(), np.full(p.size, 0.5 * (low + high))
    left = np.arange(p.size)
    least, most = np.full(p.size, low), np.full(p.size, high)
    for _ in range(_STEPS):
        now = x[left]
        over = excess(now, wanted[left])
        below, above = np.where(over > 0.0, least[left], now), np.where(over > 0.0, now, most[left])
        with np.errstate(all="ignore"):
            tried = now - over / slope(now)
        after = np.where((tried > below) & (tried < above), tried, 0.5 * (below + above))
        after = np.where(over == 0.0, now, after)
        least[left], most[left], x[left] = below, above, after
        left = left[np.abs(after - now) > _LAST_DIGITS * (high - low)]
        if not left.size:
            break
    return np.asarray(x.reshape(p.shape))


def _bisect(under: Callable[[Array], Any], low: Array, high: Array) -> Array:
    """Return the points between `low` and `high` up to which `under` holds, by bisection."""
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        below = under(middle)
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return np.asarray((low + high) / 2)
