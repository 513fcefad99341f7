"""Sigma within production batches, pooled or as in control charts, and the indices that use it.

Parts of one production batch resemble each other. The sigma within batches describes what the process could achieve if
its batches agreed; the overall sigma describes what it achieves.

The pooled sigma is the best of three estimates. R-bar / d2 and S-bar / c4, from the ranges and from the sigmas of the
batches as in control charts, are what workshops compute by hand, and what older drawings mean by the sigma within.
Batches of unequal size are weighted by their precision, as in Minitab: a range by ``d2^2 / d3^2``, a sigma by
``c4^2 / (1 - c4^2)``. The constants belong to n independent normal values of sigma 1: d2 and d3 are mean and standard
deviation of their range (Tippett 1925; Harter 1960), c4 is the mean of their sample standard deviation.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, ndtr

from reporting.arrays import ROUNDING, Array, gauss_legendre
from reporting.capability.indices import basic_intervals, cpk, point_indices
from reporting.capability.interval_choice import freedom_of_pooled
from reporting.capability.intervals import Interval
from reporting.capability.lots import variance_components
from reporting.capability.shares import ppm_of_z

# A range uses only two values: in larger batches it ignores nearly all of them, and published tables end here.
LARGEST_FOR_RANGES = 25
# Beyond 9 sigma the integrands of d2 and d3 vanish within rounding; a sum over even steps of a smooth function that
# vanishes at both ends is then accurate to rounding.
_REACH, _STEPS, _POINTS = 9.0, 361, 80


@dataclass(frozen=True)
class Within:
    """Indices with the pooled sigma within production batches: Cp and Cpk of AIAG and ISO 22514-2."""

    batches: int  # production batches with a finite value
    nu: int  # degrees of freedom of sigma: number of values minus number of batches
    std: float  # pooled sigma ``sqrt(sum (n_i - 1) s_i^2 / nu)``, in the unit of the values, without a c4 factor
    # Sigma of the batch means in excess of the sigma within (one-way analysis of variance, at least 0); None with one
    # batch.
    std_between: float | None
    cp: float | None  # indices are around the overall mean; None where a limit is missing
    cpk: float | None
    cpl: float | None
    cpu: float | None
    z_bench: float | None
    # Intervals with nu degrees of freedom, or fewer if the values within batches are not normal or the variances of
    # batches differ. They are valid for the mean of these batches: a potential index ignores how the mean of other
    # batches would differ.
    cp_interval: Interval | None
    cpk_interval: Interval | None
    cpl_interval: Interval | None
    cpu_interval: Interval | None
    ppm_expected: float | None  # share out of limits of a normal distribution with this sigma


@dataclass(frozen=True)
class SubgroupSigma:
    """Sigma within production batches by one method, and the indices computed with it."""

    method: str  # "R-bar / d2" or "S-bar / c4"
    batches: int  # those with at least two values
    std: float  # in the unit of the values
    cp: float | None  # around the overall mean; None where a limit is missing
    cpk: float | None  # like `cp`


def within(
    x: Array, batches: NDArray[np.generic], lsl: float | None, usl: float | None, confidence: float
) -> Within | None:
    """Return the indices of finite values within production batches; None where no batch has two values that differ."""
    n = int(x.size)
    if n < 2:
        return None
    mean = float(np.mean(x))
    parts = variance_components(x - mean, batches)
    if parts.within is None or math.sqrt(parts.within) <= ROUNDING * float(np.max(np.abs(x))):
        return None
    std, between, lots = math.sqrt(parts.within), parts.variance_between, int(parts.counts.size)
    index, nu = point_indices(mean, std, lsl, usl), n - lots
    _, group = np.unique(batches, return_inverse=True)
    residual = (x - mean) - (np.bincount(group, weights=x - mean) / parts.counts)[group]
    freedom = freedom_of_pooled(residual, group, confidence)
    z_bench = index["z_bench"]
    return Within(
        batches=lots,
        nu=nu,
        std=std,
        std_between=None if between is None else math.sqrt(between),
        cp=index["cp"],
        cpk=index["cpk"],
        cpl=index["cpl"],
        cpu=index["cpu"],
        z_bench=z_bench,
        **basic_intervals(index, n, freedom, confidence),
        ppm_expected=None if z_bench is None else ppm_of_z(z_bench),
    )


def subgroup_sigmas(
    x: Array, batches: NDArray[np.generic], lsl: float | None, usl: float | None
) -> tuple[SubgroupSigma, ...]:
    """Return sigma within batches from ranges (batches of up to 25 values) and from sigmas; empty without spread."""
    order = np.argsort(batches, kind="stable")
    _, starts = np.unique(batches[order], return_index=True)
    groups = [group for group in np.split(x[order], starts[1:]) if group.size > 1]
    if not groups:
        return ()
    sizes = np.array([group.size for group in groups])
    with np.errstate(over="ignore", invalid="ignore"):  # squares of values near the largest double
        found = [("S-bar / c4", [float(np.std(group, ddof=1)) for group in groups], c4, sigma_of_std)]
        if sizes.max() <= LARGEST_FOR_RANGES:
            found.insert(0, ("R-bar / d2", [float(np.ptp(group)) for group in groups], d2, d3))
        mean, least = float(np.mean(x)), ROUNDING * float(np.max(np.abs(x)))
    sigmas = []
    for method, measured, centre, spread in found:
        with np.errstate(over="ignore", invalid="ignore"):
            # weighted by its precision
            centres, spreads = (np.array([constant(int(n)) for n in sizes]) for constant in (centre, spread))
            weights = (centres / spreads) ** 2
            std = float(np.sum(weights * np.array(measured) / centres) / np.sum(weights))
        if least < std < math.inf and math.isfinite(mean):
            cp = None if lsl is None or usl is None else (usl - lsl) / (6 * std)
            nearer = None if lsl is None and usl is None else cpk(mean, std, lsl, usl)
            sigmas.append(SubgroupSigma(method, len(groups), std, cp, nearer))
    return tuple(sigmas)


@lru_cache(maxsize=1024)
def c4(n: int) -> float:
    """Return the mean of the sample standard deviation of n normal values of sigma 1, ``n >= 2``."""
    return math.sqrt(2 / (n - 1)) * math.exp(float(gammaln(n / 2) - gammaln((n - 1) / 2)))


def sigma_of_std(n: int) -> float:
    """Return the standard deviation of the sample standard deviation of n normal values of sigma 1."""
    return math.sqrt(1 - c4(n) ** 2)


@lru_cache(maxsize=64)
def d2(n: int) -> float:
    """Return the mean of the range of n normal values of sigma 1: ``E W = integral of 1 - F^n - (1 - F)^n``."""
    y = np.linspace(-_REACH, _REACH, _STEPS)
    return float(np.sum(1 - ndtr(y) ** n - ndtr(-y) ** n) * (y[1] - y[0]))


@lru_cache(maxsize=64)
def d3(n: int) -> float:
    """Return the standard deviation of the range of n normal values of sigma 1.

    ``E W^2`` is twice the integral over x < y of ``1 - F(y)^n - (1 - F(x))^n + (F(y) - F(x))^n``.
    """
    y = np.linspace(-_REACH, _REACH, _STEPS)[:, None]
    points, weights = gauss_legendre(_POINTS)
    below = _REACH * (points + 1)  # x = y - below
    inside = 1 - ndtr(y) ** n - ndtr(below - y) ** n + (ndtr(y) - ndtr(y - below)) ** n
    square = 2 * _REACH * float(np.sum(inside @ weights)) * float(y[1, 0] - y[0, 0])
    return math.sqrt(square - d2(n) ** 2)
