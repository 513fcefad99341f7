"""Distributions in closed form.

A fit evaluates them a few thousand times with different parameters, and `scipy.stats` takes fifty times as long,
because it builds and checks an object for each set of parameters. Parameters are numbers, or arrays of shape (b, 1);
then each function of m values returns the results of b distributions at once, shape (b, m).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import special
from scipy.special import ndtr, ndtri

from reporting.arrays import Array

Function = Callable[[Array], Array]
Parameter = float | Array

_HALF_LOG_2PI = 0.5 * math.log(2 * math.pi)
_HALVINGS = 80


@dataclass(frozen=True)
class ClosedForm:
    """A distribution, as functions of arrays."""

    logpdf: Function  # logarithm of the density at a value
    cdf: Function  # probability of values up to a value
    sf: Function  # probability of values above a value
    ppf: Function  # quantile of a probability


def normal_after(score: Function, log_slope: Function, inverse: Function) -> ClosedForm:
    """Return the distribution of values whose increasing `score` is standard normal.

    `log_slope` is the logarithm of its derivative, `inverse` the value of a score.
    """
    return ClosedForm(
        logpdf=lambda z: log_slope(z) - 0.5 * score(z) ** 2 - _HALF_LOG_2PI,
        cdf=lambda z: ndtr(score(z)),
        sf=lambda z: ndtr(-score(z)),
        ppf=lambda p: inverse(ndtri(p)),
    )


def normal(mean: Parameter, std: Parameter) -> ClosedForm:
    """Return the normal distribution."""
    slope = -np.log(std)
    return normal_after(lambda z: (z - mean) / std, lambda z: np.zeros_like(z) + slope, lambda s: mean + std * s)


def lognormal(low: Parameter, mean: Parameter, std: Parameter) -> ClosedForm:
    """Return the distribution of values whose ``ln(z - low)`` is normal (Johnson's SL)."""
    return normal_after(
        lambda z: (np.log(np.maximum(z - low, 0.0)) - mean) / std,
        lambda z: -np.log(z - low) - np.log(std),
        lambda s: low + np.exp(mean + std * s),
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


def weibull(shape: Parameter, scale: Parameter) -> ClosedForm:
    """Return the two-parameter Weibull distribution, ``P(Z > z) = exp(-(z/scale)^shape)``."""

    def hazard(z: Array) -> Array:
        return np.asarray(np.maximum(z / scale, 0.0) ** shape)

    return ClosedForm(
        logpdf=lambda z: np.log(shape / scale) + (shape - 1) * np.log(z / scale) - hazard(z),
        cdf=lambda z: -np.expm1(-hazard(z)),
        sf=lambda z: np.exp(-hazard(z)),
        ppf=lambda p: scale * (-np.log1p(-p)) ** (1 / shape),
    )


def gamma(shape: Parameter, scale: Parameter) -> ClosedForm:
    """Return the gamma distribution."""
    constant = -special.gammaln(shape) - np.log(scale)
    return ClosedForm(
        logpdf=lambda z: constant + (shape - 1) * np.log(z / scale) - z / scale,
        cdf=lambda z: special.gammainc(shape, np.maximum(z / scale, 0.0)),
        sf=lambda z: special.gammaincc(shape, np.maximum(z / scale, 0.0)),
        ppf=lambda p: scale * special.gammaincinv(shape, p),
    )


def beta(a: Parameter, b: Parameter) -> ClosedForm:
    """Return the beta distribution on 0 to 1."""
    constant = -special.betaln(a, b)
    return ClosedForm(
        logpdf=lambda z: constant + (a - 1) * np.log(z) + (b - 1) * np.log1p(-z),
        cdf=lambda z: special.betainc(a, b, np.clip(z, 0.0, 1.0)),
        sf=lambda z: special.betainc(b, a, np.clip(1.0 - z, 0.0, 1.0)),
        ppf=lambda p: special.betaincinv(a, b, p),
    )


def folded_normal(mean: Parameter, std: Parameter) -> ClosedForm:
    """Return the distribution of the absolute value of a normal variable; with mean 0, the half-normal distribution."""
    slope = -np.log(std) - _HALF_LOG_2PI

    def cdf(z: Array) -> Array:
        z = np.maximum(z, 0.0)
        return np.asarray(ndtr((z - mean) / std) - ndtr((-z - mean) / std))

    return ClosedForm(
        logpdf=lambda z: slope + np.logaddexp(-0.5 * ((z - mean) / std) ** 2, -0.5 * ((z + mean) / std) ** 2),
        cdf=cdf,
        sf=lambda z: np.where(z > 0, ndtr((mean - z) / std) + ndtr((-z - mean) / std), 1.0),
        ppf=lambda p: _bisect(cdf, p, np.zeros_like(p * mean), abs(mean) + std * np.abs(ndtri((1 + p) / 2))),
    )


def logistic(mean: Parameter, scale: Parameter) -> ClosedForm:
    """Return the logistic distribution."""

    def log_density(z: Array) -> Array:
        u = (z - mean) / scale
        return np.asarray(-u - 2 * np.logaddexp(0.0, -u) - np.log(scale))

    return ClosedForm(
        logpdf=log_density,
        cdf=lambda z: special.expit((z - mean) / scale),
        sf=lambda z: special.expit((mean - z) / scale),
        ppf=lambda p: mean + scale * special.logit(p),
    )


def student_t(mean: Parameter, scale: Parameter, freedom: Parameter) -> ClosedForm:
    """Return Student's t distribution, shifted and scaled."""
    half = (np.asarray(freedom) + 1) / 2
    constant = special.gammaln(half) - special.gammaln(half - 0.5) - 0.5 * np.log(np.pi * freedom) - np.log(scale)
    return ClosedForm(
        logpdf=lambda z: constant - half * np.log1p(((z - mean) / scale) ** 2 / freedom),
        cdf=lambda z: special.stdtr(freedom, (z - mean) / scale),
        sf=lambda z: special.stdtr(freedom, (mean - z) / scale),
        ppf=lambda p: mean + scale * special.stdtrit(freedom, p),
    )


def laplace(median: Parameter, scale: Parameter) -> ClosedForm:
    """Return Laplace's distribution: exponential on both sides."""

    def below(z: Array) -> Array:
        half = 0.5 * np.exp(-np.abs(z - median) / scale)
        return np.asarray(np.where(z < median, half, 1.0 - half))

    return ClosedForm(
        logpdf=lambda z: -np.abs(z - median) / scale - np.log(2 * scale),
        cdf=below,
        sf=lambda z: np.where(z < median, 1.0 - below(z), 0.5 * np.exp(-np.abs(z - median) / scale)),
        ppf=lambda p: median + scale * np.where(p < 0.5, np.log(2 * p), -np.log(2 * (1 - p))),
    )


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
    )


def two_normals(share: Parameter, mean1: Parameter, std1: Parameter, mean2: Parameter, std2: Parameter) -> ClosedForm:
    """Return a mixture of two normal distributions, the first with the probability `share`."""
    one, two = normal(mean1, std1), normal(mean2, std2)
    rest = 1.0 - share

    def cdf(z: Array) -> Array:
        return share * one.cdf(z) + rest * two.cdf(z)

    def ppf(p: Array) -> Array:
        ends = one.ppf(p), two.ppf(p)
        return _bisect(cdf, p, np.minimum(*ends), np.maximum(*ends))

    return ClosedForm(
        logpdf=lambda z: np.logaddexp(np.log(share) + one.logpdf(z), np.log(rest) + two.logpdf(z)),
        cdf=cdf,
        sf=lambda z: share * one.sf(z) + rest * two.sf(z),
        ppf=ppf,
    )


def _bisect(cdf: Function, p: Array, low: Array, high: Array) -> Array:
    """Return the points between `low` and `high` at which `cdf` is `p`, by bisection."""
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        under = cdf(middle) < p
        low, high = np.where(under, middle, low), np.where(under, high, middle)
    return np.asarray((low + high) / 2)
