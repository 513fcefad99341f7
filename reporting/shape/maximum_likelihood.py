"""Maximisation of a likelihood of a few unconstrained parameters, and the covariance of the estimates.

A damped Newton method with finite differences is used instead of `scipy.optimize` on purpose. Some families have no
maximum: their likelihood rises towards a limit, as Johnson's families do for normal values. In that case this search
stops after 50 bounded steps. scipy's BFGS and trust-region methods need two to four times as many evaluations, or stop
earlier on the same slope; for a regular maximum the log-likelihoods agree to 1e-3 or better. All points that a step
needs are evaluated at once.
"""

import math
from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from reporting.arrays import Array

Theta = tuple[float, ...]
Likelihood = Callable[[Array], Array]

# Step of a central difference that balances rounding and curvature of a log-likelihood.
_STEP = 1e-4
_ITERATIONS, _HALVINGS = 50, 30
# Step lengths tried at the same time.
_AT_ONCE = 6
# Parameters are logarithms or of order one: a longer step leaves the range where the curvature is valid.
_LONGEST = 2.0
# The search ends when the expected gain of a step in log-likelihood is smaller.
_CLIMB = 1e-9
# Curvatures below this share of the largest are raised to this share.
_FLATTEST = 1e-9


def maximise(loglik: Likelihood, start: Theta) -> Theta | None:
    """Return the maximiser of `loglik`, a function of points, shape (p, k); None if it is not finite at `start`.

    Newton's method: where the likelihood is not concave, the magnitudes of the curvatures are used; a step is halved
    until the likelihood rises.
    """
    theta = np.asarray(start, dtype=np.float64)
    best = float(loglik(theta[None])[0])
    if not math.isfinite(best):
        return None
    for _ in range(_ITERATIONS):
        gradient, hessian = _derivatives(loglik, theta, best)
        if not (np.all(np.isfinite(gradient)) and np.all(np.isfinite(hessian))):
            break
        step = _ascent(gradient, hessian)
        if float(gradient @ step) < _CLIMB:
            break
        theta, value = _line_search(loglik, theta, best, step)
        if not value > best:
            break
        best = value
    return tuple(theta.tolist())


def curvature(loglik: Likelihood, theta: Theta) -> Array | None:
    """Return the negative second derivatives at the maximum; None where they are not finite."""
    point = np.asarray(theta, dtype=np.float64)
    _, hessian = _derivatives(loglik, point, float(loglik(point[None])[0]))
    return -hessian if np.all(np.isfinite(hessian)) else None


def covariance(information: Array | None) -> tuple[tuple[float, ...], ...] | None:
    """Return the inverse of the negative second derivatives; None where they are not positive definite."""
    if information is None:
        return None
    steepness, axes = np.linalg.eigh(information)
    if steepness[0] <= _FLATTEST * steepness[-1]:
        return None
    return tuple(tuple(row) for row in ((axes / steepness) @ axes.T).tolist())


def _ascent(gradient: Array, hessian: Array) -> Array:
    """Return Newton's step, uphill in every direction, with no component above `_LONGEST`."""
    steepness, axes = np.linalg.eigh(-hessian)
    steepness = np.abs(steepness)
    steepness = np.maximum(steepness, _FLATTEST * float(np.max(steepness)) + 1e-300)
    step = axes @ ((axes.T @ gradient) / steepness)
    longest = float(np.max(np.abs(step)))
    return np.asarray(step * min(1.0, _LONGEST / longest) if longest > 0 else step)


def _line_search(loglik: Likelihood, theta: Array, best: float, step: Array) -> tuple[Array, float]:
    """Return the first point better than `best` as `step` is halved, or `theta` itself."""
    for first in range(0, _HALVINGS, _AT_ONCE):
        points = theta + step * 0.5 ** np.arange(first, first + _AT_ONCE)[:, None]
        values = loglik(points)
        better = np.flatnonzero(values > best)
        if better.size:
            return points[better[0]], float(values[better[0]])
    return theta, best


def _derivatives(loglik: Likelihood, centre: Array, middle: float) -> tuple[Array, Array]:
    """Return the gradient and the second derivatives by central differences."""
    k = centre.size
    step = _STEP * (1 + np.abs(centre))
    ahead = np.diag(step)
    first, second = _pairs(k)
    mixed = [centre + a * ahead[first] + b * ahead[second] for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1))]
    values = loglik(np.concatenate((centre + ahead, centre - ahead, *mixed)))
    up, down = values[:k], values[k : 2 * k]
    corners = values[2 * k :].reshape(4, -1)
    hessian = np.diag((up - 2 * middle + down) / step**2)
    hessian[first, second] = (corners[0] - corners[1] - corners[2] + corners[3]) / (4 * step[first] * step[second])
    hessian[second, first] = hessian[first, second]
    return (up - down) / (2 * step), hessian


@cache
def _pairs(k: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the index pairs of k parameters, the later one first; cached, as finding them outlasts a likelihood."""
    return np.tril_indices(k, -1)
