"""Maximum of a likelihood of a few unconstrained parameters, and the covariance of the estimates.

Newton's method with differences, damped, is kept in the place of `scipy.optimize` on purpose. Some families have no
maximum: their likelihood rises towards a limit, as Johnson's do on normal values. There this search stops after 50
bounded steps. scipy's BFGS and trust-region methods need two to four times as many evaluations, or stop earlier on the
same slope; for a regular maximum the log-likelihoods agree to 1e-3 and better.
"""

import math
from collections.abc import Callable

import numpy as np

from reporting.arrays import Array

Theta = tuple[float, ...]
Likelihood = Callable[[Theta], float]

# Step of a central difference that balances rounding and curvature of a log-likelihood.
_STEP = 1e-4
_ITERATIONS, _HALVINGS = 50, 30
# Parameters are logarithms or of order one: a longer step leaves the range where the curvature holds.
_LONGEST = 2.0
# The search ends when a step is expected to gain less log-likelihood.
_CLIMB = 1e-9
# Curvatures below this share of the largest count as this share.
_FLATTEST = 1e-9


def maximise(loglik: Likelihood, start: Theta) -> Theta | None:
    """Return where `loglik` is largest; None if it is not finite at `start`.

    Newton's method with central differences. Where the likelihood is not concave, the magnitudes of the curvatures are
    used; a step is halved until the likelihood rises.

    Parameters
    ----------
    loglik : callable
        From k parameters to the log-likelihood, infinite or NaN for impossible parameters.
    start : tuple of float, length k
    """
    theta, best = np.asarray(start, dtype=np.float64), loglik(start)
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


def covariance(loglik: Likelihood, theta: Theta) -> tuple[tuple[float, ...], ...] | None:
    """Return the inverse of the negative second derivatives at the maximum; None where it is not positive definite."""
    _, hessian = _derivatives(loglik, np.asarray(theta), loglik(theta))
    if not np.all(np.isfinite(hessian)):
        return None
    steepness, axes = np.linalg.eigh(-hessian)
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
    for _ in range(_HALVINGS):
        point = theta + step
        value = loglik(tuple(point.tolist()))
        if value > best:
            return point, value
        step = step / 2
    return theta, best


def _derivatives(loglik: Likelihood, centre: Array, middle: float) -> tuple[Array, Array]:
    """Return the gradient and the second derivatives by central differences."""
    k = centre.size
    step = _STEP * (1 + np.abs(centre))
    gradient, hessian = np.empty(k), np.empty((k, k))

    def at(*moves: tuple[int, float]) -> float:
        point = centre.copy()
        for i, sign in moves:
            point[i] += sign * step[i]
        return loglik(tuple(point.tolist()))

    for i in range(k):
        up, down = at((i, 1)), at((i, -1))
        gradient[i] = (up - down) / (2 * step[i])
        hessian[i, i] = (up - 2 * middle + down) / step[i] ** 2
        for j in range(i):
            mixed = at((i, 1), (j, 1)) - at((i, 1), (j, -1)) - at((i, -1), (j, 1)) + at((i, -1), (j, -1))
            hessian[i, j] = hessian[j, i] = mixed / (4 * step[i] * step[j])
    return gradient, hessian
