"""Confidence limits of capability indices and of shares.

The intervals of indices in this module use normal theory; `reporting.capability.robust_intervals` has the intervals for
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

import numpy as np
from scipy.special import betaincinv, chdtri, log_ndtr, ndtri, ndtri_exp, stdtr, stdtrit

from reporting.arrays import Array
from reporting.capability.noncentral import cpk_of_survival, noncentrality

Interval = tuple[float, float]
OpenInterval = tuple[float | None, float | None]
"""An end is None where the values set no bound on that side."""

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

    Each end is exact in its least favourable case: the lower end where one limit is much nearer (Cp far above Cpk:
    noncentral t), the upper end where both are equally near (a centred process: joint distribution of both sides).
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
    """Return Boyles' two-sided interval of Cpm from `n` values.

    ``(Cpm / Cpm_hat)^2`` is approximately chi-square over its ``n (1 + a^2)^2 / (1 + 2 a^2)`` degrees of freedom, where
    a = `offset` is the distance from target to mean in standard deviations (divisor n).
    """
    a2 = offset * offset
    return cp_interval(cpm, n * (1 + a2) ** 2 / (1 + 2 * a2), confidence)


def cc_interval(cc: float, cp: float, n: int, confidence: float) -> Interval:
    """Return the two-sided interval of Cc: Student's, of the mean in half tolerances; sigma is ``1 / (3 Cp)``."""
    return mean_interval(cc, 1.0 / (3.0 * cp), n, confidence)


def bench(z_lsl: float | None, z_usl: float | None) -> float | None:
    """Return Z.bench, the upper normal quantile of the total share out of limits; None without a limit.

    It is computed from the logarithm of the smaller of the shares inside and outside, so it stays finite where a share
    rounds to 0 or 1.
    """
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

    The variance of Z.lsl and of Z.usl is ``1/n + z^2 / (2 (n - 1))``, their covariance
    ``-1/n + z_lsl z_usl / (2 (n - 1))``.
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
