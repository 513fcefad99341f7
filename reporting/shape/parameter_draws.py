"""Plausible parameters of a fit, drawn in proportion to their likelihood.

They are drawn from the normal distribution given by the curvature of the likelihood, evenly instead of at random, and
weighted by the likelihood itself (importance sampling), so that results computed from them may be skewed. Where the
likelihood is flat, the parameters vary within a bound.
"""

import numpy as np
from scipy.special import ndtri

from reporting.arrays import Array
from reporting.capability.intervals import Interval
from reporting.distributions.families import FAMILIES
from reporting.shape.binned_sample import BinnedSample
from reporting.shape.fitting import Fit, log_likelihood
from reporting.shape.goodness import PRACTICAL
from reporting.shape.maximum_likelihood import curvature

# Number of weighted values that represent the sample.
BINNED = 240
_DRAWS = 600
# The draws extend beyond the curvature's range by this factor, but at most this far: parameters are of order one.
_BEYOND, _FARTHEST = 1.4, 1.5


def parameter_draws(fit: Fit, sample: BinnedSample) -> tuple[Array, Array]:
    """Return parameters, shape (draws, k), and their weights, shape (draws,), which sum to 1.

    More than `PRACTICAL` values are weighted as `PRACTICAL` values: a family is a model, and more values do not make
    its tails more certain. One value per parameter is used up by the fit.
    """
    theta, n = np.asarray(fit.theta), sample.n
    worth = min(1.0, PRACTICAL / n) * (1 - theta.size / n)
    loglik = log_likelihood(FAMILIES[fit.family], sample.scaled(fit.shift, fit.scale))
    with np.errstate(all="ignore"):
        information = curvature(loglik, fit.theta)
        if information is None:
            return theta[None], np.ones(1)
        steepness, axes = np.linalg.eigh(worth * information)
        reach = np.minimum(_BEYOND / np.sqrt(np.maximum(steepness, 1e-12)), _FARTHEST)
        scores = _even_normals(_DRAWS, theta.size)
        drawn = theta + (scores * reach) @ axes.T
        # The likelihood over the normal density of the scores from which the parameters are drawn.
        log_weights = worth * loglik(drawn) + 0.5 * np.sum(scores**2, axis=1)
    log_weights = np.where(np.isfinite(log_weights), log_weights, -np.inf)
    weights = np.exp(log_weights - np.max(log_weights)) if np.any(np.isfinite(log_weights)) else np.ones(_DRAWS)
    return drawn, weights / np.sum(weights)


def weighted_interval(values: Array, weights: Array, confidence: float) -> Interval:
    """Return the quantiles of weighted values that leave out equal shares at both ends.

    Values and weights have the shape (m,); the weights sum to 1, and values may be infinite.
    """
    order = np.argsort(values)
    below = np.cumsum(weights[order]) - weights[order] / 2
    ends = np.searchsorted(below, ((1 - confidence) / 2, (1 + confidence) / 2))
    low, high = values[order][np.clip(ends - np.array([1, 0]), 0, values.size - 1)]
    return float(low), float(high)


def _even_normals(count: int, k: int) -> Array:
    """Return points that fill the k-dimensional standard normal distribution evenly, shape (count, k).

    The points are multiples of the powers of 1/phi with phi^(k + 1) = phi + 1, the golden ratio for k = 1 (Roberts
    2018).
    """
    phi = 2.0
    # Each step of this fixed-point iteration divides the error by 3 or more.
    for _ in range(40):
        phi = (1 + phi) ** (1 / (k + 1))
    steps = phi ** -np.arange(1.0, k + 1)
    return np.asarray(ndtri((0.5 + np.arange(1, count + 1)[:, None] * steps) % 1.0))
