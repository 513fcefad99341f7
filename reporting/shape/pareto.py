"""The generalized Pareto distribution of excesses over a threshold: two estimators, a share, a goodness-of-fit test.

Whatever the distribution of a value, its excesses over a high threshold tend to
``P(Y > y) = (1 + xi y / sigma)^(-1/xi)`` (Pickands 1975; Balkema, de Haan 1974). For xi < 0 the distribution has an
end, for xi = 0 it is exponential.

The two estimators serve different purposes, and neither can replace the other: the interval of a share beyond a limit
is a profile likelihood, which needs the maximum of the likelihood; Pareto smoothing of weights is calibrated for the
posterior mean of Zhang and Stephens.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from reporting.arrays import Array
from reporting.capability.intervals import Interval

# Shapes searched: below -0.5 the likelihood is not regular (the tail ends abruptly), above 0.5 there is no variance.
SHAPES = (-0.5, 0.75)
# Below this logarithm of a share no excess reaches the limit, and the profile is flat.
_LEAST_LOG_SHARE = -60.0
_TINY_SHAPE = 1e-6
# 5 % points of the Cramer-von Mises statistic with both parameters fitted, simulated with 4,500 fits of 200 excesses
# at each shape. Choulakian and Stephens (2001) tabulate the same statistic.
CRITICAL_SHAPES, CRITICAL = (-0.5, -0.25, 0.0, 0.25, 0.5), (0.190, 0.169, 0.148, 0.135, 0.122)


@dataclass(frozen=True)
class ParetoFit:
    """A fitted tail."""

    shape: float  # xi
    scale: float  # sigma, in the unit of the excesses
    loglik: float  # density in 1/unit

    def survival(self, y: float) -> float:
        """Return the share of excesses beyond `y`."""
        if abs(self.shape) < _TINY_SHAPE:
            return math.exp(-y / self.scale)
        inside = 1 + self.shape * y / self.scale
        return inside ** (-1 / self.shape) if inside > 0 else 0.0


def maximum_likelihood_fit(excesses: Array) -> ParetoFit:
    """Return the maximum-likelihood fit to excesses above 0, shape (k,), that are not all equal.

    For a given ``theta = xi / sigma`` the best shape is the mean of ``ln(1 + theta y)`` (Grimshaw 1993), so the search
    is in one variable.
    """
    largest, mean = float(np.max(excesses)), float(np.mean(excesses))

    def profile(theta: float) -> ParetoFit:
        if abs(theta) * mean < _TINY_SHAPE:
            return ParetoFit(0.0, mean, -excesses.size * (math.log(mean) + 1))
        shape = min(max(float(np.mean(np.log1p(theta * excesses))), SHAPES[0]), SHAPES[1])
        return ParetoFit(shape, shape / theta, loglik(excesses, shape, shape / theta))

    # theta > -1 / largest: the distribution must not end before the largest excess.
    grid = np.concatenate((-(1 - np.geomspace(1e-3, 0.999, 40)) / largest, [0.0], np.geomspace(1e-3, 20, 40) / mean))
    return profile(_maximum(lambda theta: profile(theta).loglik, grid))


def posterior_mean_fit(excesses: Array) -> tuple[float, float]:
    """Return shape and scale by the posterior mean of ``-xi / sigma`` over a grid (Zhang and Stephens 2009).

    The excesses are above 0 and ascending. The shape is shrunk towards 0.5 with the weight of ten values, as in
    Pareto-smoothed importance sampling (Vehtari et al. 2024).
    """
    n = excesses.size
    points = 30 + int(math.sqrt(n))
    quartile = excesses[math.floor(n / 4 + 0.5) - 1]
    b = 1 / excesses[-1] + (1 - np.sqrt(points / (np.arange(1, points + 1) - 0.5))) / (3 * quartile)
    shapes = np.mean(np.log1p(-b[:, None] * excesses), axis=1)
    likelihood = n * (np.log(-b / shapes) - shapes - 1)
    posterior = np.exp(likelihood - likelihood.max())
    mean_b = float(np.sum(b * posterior) / posterior.sum())
    shape = float(np.mean(np.log1p(-mean_b * excesses)))
    return (n * shape + 10 * 0.5) / (n + 10), -shape / mean_b


def quantiles(shape: float, scale: float, p: Array) -> Array:
    """Return the quantiles for the probabilities `p`."""
    if abs(shape) < 1e-12:
        return np.asarray(-scale * np.log1p(-p))
    return np.asarray(scale * np.expm1(-shape * np.log1p(-p)) / shape)


def loglik(excesses: Array, shape: float, scale: float) -> float:
    """Return the log-likelihood of excesses; minus infinity if one lies beyond the end of the distribution."""
    if not scale > 0:
        return -math.inf
    if abs(shape) < _TINY_SHAPE:
        return -excesses.size * math.log(scale) - float(np.sum(excesses)) / scale
    inside = 1 + shape * excesses / scale
    if float(inside.min()) <= 0:
        return -math.inf
    return -excesses.size * math.log(scale) - (1 + 1 / shape) * float(np.sum(np.log(inside)))


def survival_interval(excesses: Array, y: float, fit: ParetoFit, confidence: float) -> Interval:
    """Return the profile-likelihood interval of the share of excesses beyond a distance `y` from the threshold.

    Unlike a symmetric interval, it does not extend below zero for a share of a few ppm. `fit` is the maximum-likelihood
    fit to the excesses.
    """
    from scipy.optimize import brentq  # takes 0.4 s to import, which `import reporting` avoids

    # At the ends of the interval the log-likelihood has fallen by half the chi-square quantile (likelihood ratio).
    drop = float(chdtri(1, 1 - confidence)) / 2
    estimate = fit.survival(y)
    centre = min(math.log(max(estimate, math.exp(_LEAST_LOG_SHARE))), -1e-6)

    def below_bar(log_share: float) -> float:
        return fit.loglik - drop - _profile(excesses, y, log_share)

    if below_bar(centre) >= 0:  # the limit is so far beyond the end that no other share is possible
        return estimate, estimate
    low, high = 0.0, 1.0
    if below_bar(_LEAST_LOG_SHARE) > 0 and centre > _LEAST_LOG_SHARE:
        low = math.exp(brentq(below_bar, _LEAST_LOG_SHARE, centre, xtol=1e-4))
    if below_bar(-1e-6) > 0:
        high = math.exp(brentq(below_bar, centre, -1e-6, xtol=1e-4))
    return low, high


def cramer_von_mises(excesses: Array, fit: ParetoFit) -> float:
    """Return the Cramer-von Mises statistic of ascending excesses against a fit."""
    if abs(fit.shape) < _TINY_SHAPE:
        share = -np.expm1(-excesses / fit.scale)
    else:
        share = 1 - np.maximum(1 + fit.shape * excesses / fit.scale, 1e-300) ** (-1 / fit.shape)
    k = excesses.size
    return 1 / (12 * k) + float(np.sum((share - (np.arange(1, k + 1) - 0.5) / k) ** 2))


def critical_cramer_von_mises(shape: float) -> float:
    """Return the 5 % point of `cramer_von_mises`, interpolated between the simulated shapes."""
    return float(np.interp(shape, CRITICAL_SHAPES, CRITICAL))


def _profile(excesses: Array, y: float, log_share: float) -> float:
    """Return the largest log-likelihood of a distribution with the given log-share beyond `y`."""

    def at(shape: float) -> float:
        if abs(shape) < _TINY_SHAPE:
            return loglik(excesses, 0.0, -y / log_share)
        return loglik(excesses, shape, shape * y / math.expm1(-shape * log_share))

    return at(_maximum(at, np.linspace(*SHAPES, 21)))


def _maximum(f: Callable[[float], float], grid: Array) -> float:
    """Return the maximiser of `f`, searched between the neighbours of the best point of an ascending grid."""
    from scipy.optimize import minimize_scalar  # see `survival_interval`

    values = [f(float(point)) for point in grid]
    best = int(np.argmax(values))
    ends = float(grid[max(best - 1, 0)]), float(grid[min(best + 1, grid.size - 1)])
    search = {"xatol": 1e-6 * (ends[1] - ends[0])}
    with np.errstate(invalid="ignore"):  # the likelihood of an impossible distribution is minus infinity
        top = minimize_scalar(lambda point: -f(point), bounds=ends, method="bounded", options=search)
    return float(top.x if -top.fun > values[best] else grid[best])
