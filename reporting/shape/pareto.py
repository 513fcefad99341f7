"""The generalized Pareto distribution of excesses over a threshold: fit, share beyond a limit, goodness.

Whatever the distribution of a response, its excesses over a high threshold tend to ``P(Y > y) = (1 + xi y /
sigma)^(-1/xi)`` (Pickands 1975, Balkema, de Haan 1974); xi < 0 has an end, xi = 0 is exponential.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from reporting.arrays import Array
from reporting.capability.intervals import Interval

# Shapes searched: from where the likelihood stops to be regular (a tail that ends abruptly) to one without a variance.
SHAPES = (-0.5, 0.75)
# Below this log share a limit is out of reach of any excess, and the profile is flat.
_LEAST_LOG_SHARE = -60.0
_GOLDEN = (math.sqrt(5) - 1) / 2
_STEPS = 25
_TINY_SHAPE = 1e-6
# 5 % points of the Cramer-von Mises statistic, simulated with 4,500 fits of 200 excesses at each shape; Choulakian and
# Stephens 2001 tabulate the same statistic.
CRITICAL_SHAPES, CRITICAL = (-0.5, -0.25, 0.0, 0.25, 0.5), (0.190, 0.169, 0.148, 0.135, 0.122)


@dataclass(frozen=True)
class ParetoFit:
    """Fitted tail; `scale` in the unit of the excesses, `loglik` with density in 1/unit."""

    shape: float
    scale: float
    loglik: float


def fit(excesses: Array) -> ParetoFit:
    """Return the maximum-likelihood fit to excesses of shape (k,), all above 0 and not all equal.

    Grimshaw 1993: for a given ``theta = xi / sigma`` the best shape is the mean of ``ln(1 + theta y)``, which leaves
    a search in one number.
    """
    largest, mean = float(np.max(excesses)), float(np.mean(excesses))

    def profile(theta: float) -> ParetoFit:
        if abs(theta) * mean < _TINY_SHAPE:
            return ParetoFit(0.0, mean, -excesses.size * (math.log(mean) + 1))
        shape = float(np.mean(np.log1p(theta * excesses)))
        shape = min(max(shape, SHAPES[0]), SHAPES[1])
        scale = shape / theta
        return ParetoFit(shape, scale, loglik(excesses, shape, scale))

    grid = np.concatenate((-(1 - np.geomspace(1e-3, 0.999, 40)) / largest, [0.0], np.geomspace(1e-3, 20, 40) / mean))
    tried = [profile(float(theta)).loglik for theta in grid]
    best = int(np.argmax(tried))
    ends = float(grid[max(best - 1, 0)]), float(grid[min(best + 1, grid.size - 1)])
    return profile(_climb(lambda theta: profile(theta).loglik, *ends))


def loglik(excesses: Array, shape: float, scale: float) -> float:
    """Return the log-likelihood of excesses, minus infinity where one lies beyond the end."""
    if not scale > 0:
        return -math.inf
    if abs(shape) < _TINY_SHAPE:
        return -excesses.size * math.log(scale) - float(np.sum(excesses)) / scale
    inside = 1 + shape * excesses / scale
    if float(inside.min()) <= 0:
        return -math.inf
    return -excesses.size * math.log(scale) - (1 + 1 / shape) * float(np.sum(np.log(inside)))


def survival(y: float, found: ParetoFit) -> float:
    """Return the share of excesses beyond y."""
    if abs(found.shape) < _TINY_SHAPE:
        return math.exp(-y / found.scale)
    inside = 1 + found.shape * y / found.scale
    return inside ** (-1 / found.shape) if inside > 0 else 0.0


def survival_interval(excesses: Array, y: float, found: ParetoFit, confidence: float) -> Interval:
    """Return the profile-likelihood interval of the share of excesses beyond y.

    Skewed as such shares are: a symmetric interval of a share of ppm would reach below zero.
    """
    from scipy.optimize import brentq

    drop = float(chdtri(1, 1 - confidence)) / 2
    estimate = survival(y, found)
    centre = min(math.log(max(estimate, math.exp(_LEAST_LOG_SHARE))), -1e-6)

    def excess(log_share: float) -> float:
        return found.loglik - drop - _profile(excesses, y, log_share)

    if excess(centre) >= 0:  # the limit is so far beyond the end that no other share is possible
        return estimate, estimate
    low, high = 0.0, 1.0
    if excess(_LEAST_LOG_SHARE) > 0 and centre > _LEAST_LOG_SHARE:
        low = math.exp(brentq(excess, _LEAST_LOG_SHARE, centre, xtol=1e-4))
    if excess(-1e-6) > 0:
        high = math.exp(brentq(excess, centre, -1e-6, xtol=1e-4))
    return low, high


def crookedness(excesses: Array, found: ParetoFit) -> float:
    """Return the Cramer-von Mises statistic of ascending excesses against the fit."""
    inside = np.maximum(1 + found.shape * excesses / found.scale, 1e-300)
    shape = found.shape if abs(found.shape) > _TINY_SHAPE else _TINY_SHAPE
    share = 1 - inside ** (-1 / shape) if abs(found.shape) > _TINY_SHAPE else -np.expm1(-excesses / found.scale)
    k = excesses.size
    return 1 / (12 * k) + float(np.sum((share - (np.arange(1, k + 1) - 0.5) / k) ** 2))


def critical_crookedness(shape: float) -> float:
    """Return the 5 % point of `crookedness` with both parameters fitted, interpolated between simulated shapes."""
    return float(np.interp(shape, CRITICAL_SHAPES, CRITICAL))


def _profile(excesses: Array, y: float, log_share: float) -> float:
    """Return the largest log-likelihood with this share beyond y."""

    def at(shape: float) -> float:
        if abs(shape) < _TINY_SHAPE:
            return loglik(excesses, 0.0, -y / log_share)
        return loglik(excesses, shape, shape * y / math.expm1(-shape * log_share))

    grid = np.linspace(*SHAPES, 21)
    tried = [at(float(shape)) for shape in grid]
    best = int(np.argmax(tried))
    top = _climb(at, float(grid[max(best - 1, 0)]), float(grid[min(best + 1, grid.size - 1)]))
    return max(at(top), tried[best])


def _climb(f: Callable[[float], float], low: float, high: float) -> float:
    """Return where f is largest between low and high, by golden sections."""
    left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    f_left, f_right = f(left), f(right)
    for _ in range(_STEPS):
        if f_left < f_right:
            low, left, f_left = left, right, f_right
            right = low + _GOLDEN * (high - low)
            f_right = f(right)
        else:
            high, right, f_right = right, left, f_left
            left = high - _GOLDEN * (high - low)
            f_left = f(left)
    return (low + high) / 2
