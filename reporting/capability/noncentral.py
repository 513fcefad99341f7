"""Exact sampling distributions of Cpl, Cpu and Cpk of normal values.

Let ``U = s / sigma``: ``U^2`` is chi-square over its degrees of freedom and independent of the mean. Every probability
is then ``E[g(U)]`` of a smooth step g, one integral by Gauss-Legendre quadrature. `scipy.stats.nct` loses digits, or
does not return, at large noncentralities (30,000 samples of Cpk 5 give 2,600).
"""

import math
from collections.abc import Callable
from functools import lru_cache
from itertools import pairwise

import numpy as np
from scipy.special import chdtri, gammaln, ndtr, ndtri

from reporting.arrays import Array

# Probability left out at each end of the chi distribution: rounding error.
_TAIL = 1e-16
# Beyond this many standard deviations the normal distribution function is 0 or 1 within rounding.
_NORMAL_REACH = 9.0
# Step of the search for a root, in standard deviations of the estimate: about the error of the first guess.
_FIRST_STEP = 0.1


def noncentral_t_cdf(t: float, nu: float, delta: float) -> float:
    """Return ``P(T <= t) = E[Phi(t U - delta)]`` of the noncentral t distribution; t > 0."""
    return _expectation(lambda u: ndtr(t * u - delta), nu, delta / t, _NORMAL_REACH / t)


def noncentrality(t: float, nu: float, probability: float) -> float:
    """Return the noncentrality delta with ``P(T <= t) = probability``, for t >= 0."""
    if t < 1e-12:  # P(T <= 0) = Phi(-delta)
        return -float(ndtri(probability))
    spread = math.sqrt(1 + t * t / (2 * nu))  # of delta, if s were normal
    guess = t - float(ndtri(probability)) * spread
    within = -_NORMAL_REACH, t * _chi_ends(nu)[1] + _NORMAL_REACH
    return _root(lambda delta: probability - noncentral_t_cdf(t, nu, delta), guess, spread, within)


def cpk_survival(observed: float, n: int, cpk: float) -> float:
    """Return ``P(Cpk_hat > observed)`` for `n` values if both limits of the true process are equally near.

    The true process has ``Cpl = cpk`` and ``Cpu = |cpk|``: it is centred for a positive Cpk; for a negative one the
    limits coincide. Any other Cp gives a larger probability, so this is the least favourable case.
    """
    reach = 3.0 * math.sqrt(n)

    def inside(u: Array) -> Array:
        both = ndtr(reach * (abs(cpk) - observed * u)) - ndtr(-reach * (cpk - observed * u))
        return np.maximum(np.asarray(both, dtype=np.float64), 0.0)

    if abs(observed) * reach < 1e-12:
        return _expectation(inside, n - 1, 1.0, 0.0)
    return _expectation(inside, n - 1, cpk / observed, _NORMAL_REACH / (reach * abs(observed)))


def cpk_of_survival(observed: float, n: int, probability: float) -> float:
    """Return the Cpk of the process for which ``cpk_survival(observed, n, cpk)`` is `probability`."""
    low, high, _ = _chi_ends(n - 1)
    margin = _NORMAL_REACH / (3.0 * math.sqrt(n))
    within = observed * (low if observed > 0 else high) - margin, max(observed * high, 0.0) + margin
    spread = math.sqrt(1 / (9 * n) + observed * observed / (2 * (n - 1)))  # of Cpk, if s were normal
    guess = observed + float(ndtri(probability)) * spread
    return _root(lambda cpk: cpk_survival(observed, n, cpk) - probability, guess, spread, within)


def _root(rising: Callable[[float], float], guess: float, spread: float, within: tuple[float, float]) -> float:
    """Return the zero of an increasing function; the search starts near a guess, with an error of about `spread`."""
    from scipy.optimize import brentq  # takes 0.4 s, which `import reporting` avoids

    near = min(max(guess, within[0]), within[1])
    value, step = rising(near), _FIRST_STEP * spread
    while value != 0.0:
        far = min(near + step, within[1]) if value < 0 else max(near - step, within[0])
        beyond = rising(far)
        if value * beyond <= 0 or far == near:
            return float(brentq(rising, near, far, rtol=1e-13))
        # Growing steps: a root far from the guess costs only a few evaluations more.
        near, value, step = far, beyond, 4 * step
    return near


def _expectation(g: Callable[[Array], Array], nu: float, centre: float, width: float) -> float:
    """Return ``E[g(U)]``, where g steps from 0 to 1 within `width` around `centre`.

    The integral is split at the step; each piece is smooth enough for 40 Gauss points.
    """
    low, high, log_norm = _chi_ends(nu)
    ends = [low, *(min(max(end, low), high) for end in (centre - width, centre, centre + width)), high]
    pieces = np.array([((b + a) / 2, (b - a) / 2) for a, b in pairwise(ends) if b > a])
    points, weights = _gauss()
    u = pieces[:, :1] + pieces[:, 1:] * points
    log_density = log_norm + (nu - 1) * np.log(u) - nu / 2 * u * u
    return float(pieces[:, 1] @ (g(u) * np.exp(log_density) @ weights))


@lru_cache(maxsize=64)
def _chi_ends(nu: float) -> tuple[float, float, float]:
    """Return the range of U, and the logarithm of the normalising constant of its density."""
    low, high = (math.sqrt(float(chdtri(nu, p)) / nu) for p in (1.0 - _TAIL, _TAIL))
    log_norm = math.log(2) + nu / 2 * math.log(nu / 2) - float(gammaln(nu / 2))
    return low, high, log_norm


@lru_cache(maxsize=1)
def _gauss() -> tuple[Array, Array]:
    """Return the 40 Gauss-Legendre points and weights on [-1, 1]."""
    points, weights = np.polynomial.legendre.leggauss(40)
    return points, weights
