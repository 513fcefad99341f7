"""Confidence limits of capability indices and of shares.

Every function takes the two-sided (indices) or one-sided (shares) confidence and returns plain floats.

- Cp: chi-square distribution of the variance (Chou, Owen, Borrego 1990).
- Cpk: Bissell 1990, normal approximation.
- Cpl, Cpu: exact. ``3 sqrt(n) Cpu_hat`` has a noncentral t distribution with ``n - 1`` degrees of freedom and
  noncentrality ``3 sqrt(n) Cpu``; its limits are those that make the observed value a quantile.
- Share of rejects: Clopper and Pearson 1934, a quantile of the beta distribution.
"""

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv, chdtri, gammaln, ndtr, ndtri

Interval = tuple[float, float]

# Probability left out at each end when the chi distribution is integrated: at rounding level.
_TAIL = 1e-16
# Beyond this many standard deviations the normal distribution function is 0 or 1 to rounding.
_NORMAL_REACH = 9.0


def cp_interval(cp: float, n: int, confidence: float) -> Interval:
    """Return the two-sided interval of Cp from `n` values, ``Cp sqrt(chi2(p, n-1) / (n-1))``."""
    nu, alpha = n - 1, 1.0 - confidence
    low, high = chdtri(nu, 1.0 - alpha / 2), chdtri(nu, alpha / 2)
    return cp * math.sqrt(low / nu), cp * math.sqrt(high / nu)


def cpk_half_width(cpk: float, n: int, confidence: float) -> float:
    """Return Bissell's half width of the two-sided interval of Cpk, ``z sqrt(1/(9n) + Cpk^2/(2(n-1)))``."""
    z = float(ndtri(0.5 + confidence / 2))
    return z * math.sqrt(1.0 / (9 * n) + cpk * cpk / (2 * (n - 1)))


def cpk_interval(cpk: float, n: int, confidence: float) -> Interval:
    """Return Bissell's two-sided interval of Cpk from `n` values."""
    half = cpk_half_width(cpk, n, confidence)
    return cpk - half, cpk + half


def one_sided_interval(index: float, n: int, confidence: float) -> Interval:
    """Return the exact two-sided interval of Cpl or Cpu from `n` values.

    Its lower end is the one-sided lower bound at confidence ``(1 + confidence) / 2``.
    """
    if index < 0:  # the distribution mirrors: T(-delta) = -T(delta)
        low, high = one_sided_interval(-index, n, confidence)
        return -high, -low
    scale = 3.0 * math.sqrt(n)
    upper, lower = 0.5 + confidence / 2, 0.5 - confidence / 2
    t = scale * index
    return _noncentrality(t, n - 1, upper) / scale, _noncentrality(t, n - 1, lower) / scale


def share_upper_bound(count: int, n: int, confidence: float) -> float:
    """Return the one-sided Clopper-Pearson upper bound of a share of which `count` in `n` was seen."""
    return 1.0 if count >= n else float(betaincinv(count + 1, n - count, confidence))


def share_lower_bound(count: int, n: int, confidence: float) -> float:
    """Return the one-sided Clopper-Pearson lower bound of a share of which `count` in `n` was seen."""
    return 0.0 if count <= 0 else float(betaincinv(count, n - count + 1, 1.0 - confidence))


def _noncentrality(t: float, nu: int, probability: float) -> float:
    """Return the noncentrality delta with ``P(T <= t) = probability``, for t >= 0."""
    from scipy.optimize import brentq  # half a second of import that `import reporting` need not pay

    if t < 1e-12:  # P(T <= 0) = Phi(-delta)
        return -float(ndtri(probability))
    high = t * float(_chi_nodes(nu)[1]) + _NORMAL_REACH
    return float(brentq(lambda d: noncentral_t_cdf(t, nu, d) - probability, -_NORMAL_REACH, high, rtol=1e-13))


def noncentral_t_cdf(t: float, nu: int, delta: float) -> float:
    """Return ``P(T <= t) = E[Phi(t U - delta)]`` with ``U^2`` chi-square over its degrees of freedom; t > 0.

    Written out because scipy's routines lose digits, or never return, at large noncentralities (30,000
    samples of Cpk 5 give 2,600). The integrand steps from 0 to 1 around ``U = delta / t`` in a width of
    ``1 / t``: the interval is split there, and each piece is smooth enough for 40 Gauss points.
    """
    low, high, log_norm = _chi_nodes(nu)
    step = (delta + _NORMAL_REACH * np.array([-1.0, 0.0, 1.0])) / t
    ends = np.concatenate(([low], np.clip(step, low, high), [high]))
    half = np.diff(ends)[:, None] / 2
    points, weights = _gauss()
    u = (ends[:-1] + ends[1:])[:, None] / 2 + half * points
    log_density = log_norm + (nu - 1) * np.log(np.maximum(u, 1e-300)) - nu * u * u / 2
    return float(np.sum(half * weights * ndtr(t * u - delta) * np.exp(log_density)))


@lru_cache(maxsize=64)
def _chi_nodes(nu: int) -> tuple[float, float, float]:
    """Return the ends between which U lives and the logarithm of its density's constant."""
    low, high = (math.sqrt(float(chdtri(nu, p)) / nu) for p in (1.0 - _TAIL, _TAIL))
    log_norm = math.log(2) + nu / 2 * math.log(nu / 2) - float(gammaln(nu / 2))
    return low, high, log_norm


@lru_cache(maxsize=1)
def _gauss() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the 40 Gauss-Legendre points and weights on [-1, 1]."""
    points, weights = np.polynomial.legendre.leggauss(40)
    return points, weights
