"""Exact factors k of normal tolerance intervals: ``mean -+ k s`` contains a share of the production.

One-sided: ``sqrt(n) k`` is a quantile of the noncentral t distribution with noncentrality ``sqrt(n) z_P`` (Hahn and
Meeker 1991). Two-sided: the content of ``mean -+ k s`` is at least P if s is at least ``r(x) / k``, with x the error
of the mean in sigmas and ``Phi(x + r) - Phi(x - r) = P``; the probability of that is one integral over x (Odeh and Owen
1980; Eberhardt, Mee, Reeve 1989; ISO 16269-6, annex F). No approximation is used.
"""

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np
from scipy.special import chdtrc, ndtr, ndtri

from reporting.arrays import Array
from reporting.capability.noncentral import noncentral_t_cdf

# Standard errors of the mean beyond which its distribution is negligible; number of Gauss-Legendre points up to there.
_REACH, _POINTS = 8.5, 160
_PRECISION = 1e-12


@lru_cache(maxsize=256)
def one_sided_factor(n: float, content: float, confidence: float, nu: float | None = None) -> float:
    """Return k such that at least the share `content` (from 0.5) of production lies below ``mean + k s``.

    `n` independent values determine the mean equally well; s has `nu` degrees of freedom, by default ``n - 1``.
    """
    freedom, shift = n - 1 if nu is None else nu, math.sqrt(n) * float(ndtri(content))
    return _root(lambda t: noncentral_t_cdf(t, freedom, shift) - confidence, shift + 1.0) / math.sqrt(n)


@lru_cache(maxsize=256)
def two_sided_factor(n: float, content: float, confidence: float, nu: float | None = None) -> float:
    """Return k such that at least the share `content` of production lies within ``mean -+ k s``.

    `n` independent values determine the mean equally well; s has `nu` degrees of freedom, by default ``n - 1``.
    """
    freedom = n - 1 if nu is None else nu
    points, weights = _gauss()
    z = _REACH * (points + 1) / 2
    density = _REACH * weights * np.exp(-z * z / 2) / math.sqrt(2 * math.pi)  # for both signs of the error
    square = freedom * _half_widths(z / math.sqrt(n), content) ** 2
    return _root(lambda k: float(density @ chdtrc(freedom, square / k**2)) - confidence, 2.0)


@lru_cache(maxsize=1)
def _gauss() -> tuple[Array, Array]:
    """Return the Gauss-Legendre points and weights on [-1, 1]."""
    points, weights = np.polynomial.legendre.leggauss(_POINTS)
    return points, weights


def _half_widths(x: Array, content: float) -> Array:
    """Return r with ``Phi(x + r) - Phi(x - r) = content``, by bisection on the tails, which keep their digits."""
    low: Array = np.full(x.size, float(ndtri((1 + content) / 2)))
    high: Array = x + low
    for _ in range(60):
        middle = (low + high) / 2
        short = ndtr(x - middle) + ndtr(-x - middle) > 1 - content
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    return np.asarray((low + high) / 2)


def _root(rising: Callable[[float], float], start: float) -> float:
    """Return the zero of an increasing function of a positive number."""
    from scipy.optimize import brentq  # takes 0.4 s, which `import reporting` avoids

    low = high = start
    while rising(low) > 0:
        low /= 2
    while rising(high) < 0:
        high *= 2
    return float(brentq(rising, low, high, xtol=_PRECISION, rtol=_PRECISION)) if low < high else start
