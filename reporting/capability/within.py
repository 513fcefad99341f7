"""Sigma within production batches, and the indices that use it.

Parts of one production batch resemble each other. The sigma within batches describes what the process could achieve if
its batches agreed; the overall sigma describes what it achieves.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from reporting.arrays import Array
from reporting.capability.indices import basic_intervals, point_indices
from reporting.capability.intervals import Interval
from reporting.capability.lots import variance_components
from reporting.capability.moments import ROUNDING
from reporting.capability.precision import freedom_of_pooled
from reporting.capability.shares import ppm_of_z


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
