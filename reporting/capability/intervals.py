"""Confidence limits of capability indices and of shares.

The intervals of indices in this module use normal theory; `reporting.capability.interval_choice` has the intervals for
any distribution. Functions for indices take a two-sided confidence, functions for bounds of shares a one-sided one.
`nu` is the number of degrees of freedom of sigma: ``n - 1`` for the overall sigma, the number of values minus the
number of batches for the sigma within.

- Cp: chi-square distribution of the variance (Chou, Owen, Borrego 1990).
- Cpk: normal approximation of Bissell (1990), the report's default. Minitab, JMP and qcc print it, and its coverage is
  correct if one limit is much nearer than the other. The joint interval is given as well; it is exact in the least
  favourable case (a question of Kushler and Hurley 1992), so its coverage is at least the stated one for every n and
  centring. Their shortcut ``Cpk (1 -+ z / sqrt(2n - 2))`` neglects the error of the mean and is not used.
- Cpl, Cpu: exact. ``3 sqrt(n) Cpu_hat`` has a noncentral t distribution with nu degrees of freedom and
  noncentrality ``3 sqrt(n) Cpu``; the limits are the noncentralities that make the observed value a quantile.
- Cpm: Boyles (1991), chi-square with degrees of freedom from the offset to the target.
- Cc and mean: Student's t. Standard deviation: chi-square. Z.bench: delta method.
- Share of rejects: Clopper and Pearson (1934), a quantile of the beta distribution.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from scipy.special import betaincinv, chdtri, gammaln, log_ndtr, ndtr, ndtri, ndtri_exp, stdtr, stdtrit

from reporting.arrays import Array, gauss_legendre

# Exact sampling distributions of Cpl, Cpu and Cpk of normal values.
#
# Let ``U = s / sigma``: ``U^2`` is chi-square over its degrees of freedom and independent of the mean. Every
# probability is then ``E[g(U)]`` of a smooth step g, one integral by Gauss-Legendre quadrature. `scipy.stats.nct` loses
# digits, or does not return, at large noncentralities (30,000 samples of Cpk 5 give 2,600).

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

    Any other Cp gives a larger probability. For a negative Cpk the limits coincide, with ``Cpu = |cpk|``.
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
    points, weights = gauss_legendre(40)
    u = pieces[:, :1] + pieces[:, 1:] * points
    log_density = log_norm + (nu - 1) * np.log(u) - nu / 2 * u * u
    return float(pieces[:, 1] @ (g(u) * np.exp(log_density) @ weights))


@lru_cache(maxsize=64)
def _chi_ends(nu: float) -> tuple[float, float, float]:
    """Return the range of U, and the logarithm of the normalising constant of its density."""
    low, high = (math.sqrt(float(chdtri(nu, p)) / nu) for p in (1.0 - _TAIL, _TAIL))
    log_norm = math.log(2) + nu / 2 * math.log(nu / 2) - float(gammaln(nu / 2))
    return low, high, log_norm


Interval = tuple[float, float]
OpenInterval = tuple[float | None, float | None]
"""An end is None where the values set no bound on that side."""


@dataclass(frozen=True)
class Estimate:
    """A number with its interval, the method in a word or two; a note: its numbers as the subject of a sentence."""

    value: float  # infinite where it has no bound, like the ends
    interval: Interval
    method: str
    note: str

    @property
    def low(self) -> float:
        """Lower end of the interval."""
        return self.interval[0]

    @property
    def high(self) -> float:
        """Upper end of the interval."""
        return self.interval[1]


# Above this t the error of the mean is negligible compared with that of sigma: chi-square limits are exact to rounding.
_LARGE_T = 1e8
# Above this z the ratio of density and tail is z to 0.1 %, and the ratio of two densities loses its digits.
_LARGE_Z = 30.0


def with_ends(interval: OpenInterval) -> Interval:
    """Return an interval in which an end without a bound is infinite."""
    low, high = interval
    return -math.inf if low is None else low, math.inf if high is None else high


def cp_interval(cp: float, nu: float, confidence: float) -> Interval:
    """Return the two-sided interval of Cp, ``Cp sqrt(chi2(p, nu) / nu)``."""
    alpha = 1.0 - confidence
    low, high = chdtri(nu, 1.0 - alpha / 2), chdtri(nu, alpha / 2)
    return cp * math.sqrt(low / nu), cp * math.sqrt(high / nu)


def cpk_half_width(cpk: float, n: int, confidence: float, nu: float | None = None) -> float:
    """Return Bissell's half width of the two-sided interval of Cpk, ``z sqrt(1/(9n) + Cpk^2/(2 nu))``."""
    z = float(ndtri(0.5 + confidence / 2))
    return z * math.sqrt(1.0 / (9 * n) + cpk * cpk / (2 * (nu or n - 1)))


def cpk_interval(cpk: float, n: int, confidence: float, nu: float | None = None) -> Interval:
    """Return Bissell's two-sided interval of Cpk from `n` values."""
    half = cpk_half_width(cpk, n, confidence, nu)
    return cpk - half, cpk + half


def cpk_joint_interval(cpk: float, n: int, confidence: float) -> Interval:
    """Return an interval of Cpk with two limits whose coverage is at least the stated one for every Cp.

    The lower end is exact where one limit is much nearer (noncentral t), the upper end for a centred process.
    """
    upper = 0.5 + confidence / 2
    if cpk * 3.0 * math.sqrt(n) > _LARGE_T:
        return cp_interval(cpk, n - 1, confidence)
    return one_sided_interval(cpk, n, confidence)[0], cpk_of_survival(cpk, n, upper)


def one_sided_interval(index: float, n: int, confidence: float, nu: float | None = None) -> Interval:
    """Return the exact two-sided interval of Cpl or Cpu from `n` values.

    Its lower end is the one-sided lower bound with the confidence ``(1 + confidence) / 2``.
    """
    if index < 0:  # T(-delta) has the distribution of -T(delta)
        low, high = one_sided_interval(-index, n, confidence, nu)
        return -high, -low
    scale = 3.0 * math.sqrt(n)
    upper, lower = 0.5 + confidence / 2, 0.5 - confidence / 2
    t, freedom = scale * index, nu or n - 1
    if t > _LARGE_T:
        return cp_interval(index, freedom, confidence)
    return noncentrality(t, freedom, upper) / scale, noncentrality(t, freedom, lower) / scale


def cpm_interval(cpm: float, offset: float, n: int, confidence: float) -> Interval:
    """Return Boyles' two-sided interval of Cpm from `n` values, the target `offset` sigmas (divisor n) off the mean.

    ``(Cpm / Cpm_hat)^2`` is about chi-square over its ``n (1 + a^2)^2 / (1 + 2 a^2)`` degrees of freedom, a the offset.
    """
    a2 = offset * offset
    return cp_interval(cpm, n * (1 + a2) ** 2 / (1 + 2 * a2), confidence)


def cc_interval(cc: float, cp: float, n: int, confidence: float) -> Interval:
    """Return the two-sided interval of Cc: Student's, of the mean in half tolerances; sigma is ``1 / (3 Cp)``."""
    return mean_interval(cc, 1.0 / (3.0 * cp), n, confidence)


def bench(z_lsl: float | None, z_usl: float | None) -> float | None:
    """Return Z.bench, the upper normal quantile of the share out of limits, finite even if a share rounds to 0 or 1."""
    if z_lsl is None or z_usl is None:
        return z_lsl if z_usl is None else z_usl
    if min(z_lsl, z_usl) > 0:
        near, far = log_ndtr(-min(z_lsl, z_usl)), log_ndtr(-max(z_lsl, z_usl))
        # A share that rounds to 1 would have the logarithm 0 and no quantile: it is kept just below.
        return -float(ndtri_exp(min(near + math.log1p(math.exp(far - near)), -math.ulp(0.0))))
    near, far = log_ndtr(min(z_lsl, z_usl)), log_ndtr(-max(z_lsl, z_usl))
    return float(ndtri_exp(near + math.log1p(-math.exp(min(far - near, -math.ulp(1.0))))))


def bench_interval(z_lsl: float | None, z_usl: float | None, n: int, confidence: float) -> Interval | None:
    """Return the two-sided interval of Z.bench: exact for one limit, from the delta method for two.

    Z.lsl and Z.usl have the variance ``1/n + z^2 / (2 (n - 1))`` and covariance ``-1/n + z_lsl z_usl / (2 (n - 1))``.
    """
    slopes = bench_slopes(z_lsl, z_usl)
    if slopes is None:
        return None
    z, slope_l, slope_u = slopes
    if z_lsl is None or z_usl is None:
        low, high = one_sided_interval(z / 3, n, confidence)
        return 3 * low, 3 * high
    spread = slope_l * z_lsl + slope_u * z_usl
    variance = (slope_l - slope_u) ** 2 / n + spread * spread / (2 * (n - 1))
    half = float(ndtri(0.5 + confidence / 2)) * math.sqrt(variance)
    return z - half, z + half


def bench_slopes(z_lsl: float | None, z_usl: float | None) -> tuple[float, float, float] | None:
    """Return Z.bench and its derivatives with respect to Z.lsl and Z.usl; None without a limit."""
    z = bench(z_lsl, z_usl)
    if z is None:
        return None
    if z_lsl is None or z_usl is None:
        # Z.bench is the Z of the only side: slope 1 there, 0 on the missing one.
        return z, float(z_usl is None), float(z_lsl is None)
    return z, _bench_slope(z, z_lsl), _bench_slope(z, z_usl)


def _bench_slope(z: float, side: float) -> float:
    """Return the derivative of Z.bench `z` with respect to the Z of one side: the ratio of their normal densities."""
    if z > _LARGE_Z:
        # The exponents are bounded because the caller squares the slope, which must not overflow.
        return side / z * math.exp(min(float(log_ndtr(-side)) - float(log_ndtr(-z)), 300.0))
    return math.exp(min((z * z - side * side) / 2, 300.0))


def mean_interval(mean: float, std: float, n: int, confidence: float) -> Interval:
    """Return the two-sided interval of the mean of `n` values, ``mean -+ t s / sqrt(n)``."""
    half = float(stdtrit(n - 1, 0.5 + confidence / 2)) * std / math.sqrt(n)
    return mean - half, mean + half


def welch(a: Array, b: Array, confidence: float) -> tuple[float, Interval, float]:
    """Return the difference of two means, its two-sided interval and the p-value of equal means (Welch 1947).

    `scipy.stats.ttest_ind` gives the same numbers, but warns where a group is constant.
    """
    squares = [float(np.var(x, ddof=1)) / x.size for x in (a, b)]
    difference, error = float(a.mean() - b.mean()), math.sqrt(sum(squares))
    if error == 0:
        return difference, (difference, difference), 1.0 if difference == 0 else 0.0
    freedom = sum(squares) ** 2 / (squares[0] ** 2 / (a.size - 1) + squares[1] ** 2 / (b.size - 1))
    half = float(stdtrit(freedom, 0.5 + confidence / 2)) * error
    return difference, (difference - half, difference + half), 2 * float(stdtr(freedom, -abs(difference) / error))


def std_interval(std: float, n: int, confidence: float) -> Interval:
    """Return the two-sided interval of the standard deviation of `n` values, ``s sqrt((n-1) / chi2(p, n-1))``."""
    nu, alpha = n - 1, 1.0 - confidence
    return std * math.sqrt(nu / chdtri(nu, alpha / 2)), std * math.sqrt(nu / chdtri(nu, 1.0 - alpha / 2))


def fisher_interval(r: float, n: float, confidence: float) -> Interval:
    """Return the two-sided interval of Pearson's r of n pairs, by Fisher's z; [-1, 1] up to three pairs."""
    if n <= 3.0:
        return -1.0, 1.0
    if abs(r) >= 1.0:
        return r, r
    half = float(ndtri(0.5 + confidence / 2)) / math.sqrt(n - 3.0)
    return math.tanh(math.atanh(r) - half), math.tanh(math.atanh(r) + half)


def share_interval(count: float, n: float, confidence: float) -> Interval:
    """Return the two-sided Clopper-Pearson interval of a share, `count` of `n` observed."""
    one_sided = 0.5 + confidence / 2
    return share_lower_bound(count, n, one_sided), share_upper_bound(count, n, one_sided)


def share_upper_bound(count: float, n: float, confidence: float) -> float:
    """Return the one-sided Clopper-Pearson upper bound of a share, `count` of `n` observed."""
    return 1.0 if count >= n else float(betaincinv(count + 1, n - count, confidence))


def share_lower_bound(count: float, n: float, confidence: float) -> float:
    """Return the one-sided Clopper-Pearson lower bound of a share, `count` of `n` observed."""
    return 0.0 if count <= 0 else float(betaincinv(count, n - count + 1, 1.0 - confidence))
