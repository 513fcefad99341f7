"""Maximum of a likelihood of a few parameters without constraints, and its curvature there."""

import math
from collections.abc import Callable

import numpy as np

from reporting.arrays import Array

Theta = tuple[float, ...]
Likelihood = Callable[[Theta], float]

# Step of a central difference that balances rounding and curvature of a log-likelihood.
_STEP = 1e-4
_ITERATIONS, _HALVINGS = 50, 30
# Parameters are of order one or logarithms: a longer step trusts the curvature too far.
_LONGEST = 2.0
# A climb that Newton's model expects to be below this many units of log-likelihood is none.
_CLIMB = 1e-9
# Directions flatter than this share of the steepest are treated as if they were that steep.
_FLATTEST = 1e-9


def maximise(loglik: Likelihood, start: Theta) -> Theta | None:
    """Return where `loglik` is largest, None if `start` is impossible already.

    Newton's method with central differences; where the likelihood is not concave it climbs along the magnitudes of
    the curvature, and a step is halved until it climbs.

    Parameters
    ----------
    loglik : callable
        From k parameters to the log-likelihood; it may be infinite or NaN where they are impossible.
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
        closer, value = _line(loglik, theta, best, step)
        if not value > best:
            break
        theta, best = closer, value
    return tuple(theta.tolist())


def curvature(loglik: Likelihood, theta: Theta) -> tuple[tuple[float, ...], ...] | None:
    """Return the inverse of the negative second derivatives, the covariance of theta; None where it is none."""
    _, hessian = _derivatives(loglik, np.asarray(theta), loglik(theta))
    if not np.all(np.isfinite(hessian)):
        return None
    steepness, axes = np.linalg.eigh(-hessian)
    if steepness[0] <= _FLATTEST * steepness[-1]:
        return None
    return tuple(tuple(row) for row in ((axes / steepness) @ axes.T).tolist())


def _ascent(gradient: Array, hessian: Array) -> Array:
    """Return Newton's step, uphill in every direction and no longer than `_LONGEST`."""
    steepness, axes = np.linalg.eigh(-hessian)
    steepness = np.abs(steepness)
    steepness = np.maximum(steepness, _FLATTEST * float(np.max(steepness)) + 1e-300)
    step = axes @ ((axes.T @ gradient) / steepness)
    longest = float(np.max(np.abs(step)))
    return np.asarray(step * min(1.0, _LONGEST / longest) if longest > 0 else step)


def _line(loglik: Likelihood, theta: Array, best: float, step: Array) -> tuple[Array, float]:
    """Return the first point along the halved `step` that is better than `best`, or `theta` itself."""
    for _ in range(_HALVINGS):
        point = theta + step
        value = loglik(tuple(point.tolist()))
        if value > best:
            return point, value
        step = step / 2
    return theta, best


def _derivatives(loglik: Likelihood, centre: Array, middle: float) -> tuple[Array, Array]:
    """Return gradient and second derivatives by central differences."""
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
