"""What separates the failed samples from the ok ones: each variable in both groups.

Failures often come from one variable, on one side of its range or at both ends, where a tolerance is too large or was
mistyped. So two distances of the distributions (Kolmogorov, Smirnov) are taken: of the values, and of their distances
from the requested mean. The larger one ranks the variables. Two samples in a group are enough, which may be all that is
left.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import kolmogorov

from reporting.arrays import Array, random_rows
from reporting.samples import Samples
from reporting.sensitivity.rejects import largest_distance
from reporting.spec import VariableSpec


@dataclass(frozen=True)
class FailedAgainstOk:
    """One variable among the failed and among the ok samples, in its unit."""

    variable: str
    mean_failed: float
    low_failed: float  # smallest value
    high_failed: float  # largest value
    mean_ok: float
    low_ok: float
    high_ok: float
    distance: float  # of the distribution functions, 0 to 1: of the values, or of their distances from the mean
    p: float  # probability of a distance at least as large by chance (asymptotic, doubled for the two distances)


def failed_against_ok(samples: Samples, variables: tuple[VariableSpec, ...]) -> tuple[FailedAgainstOk, ...]:
    """Compare each variable that varies between failed and ok samples, the clearest difference first.

    Empty without a sample in one of the groups, or without variables that vary.
    """
    found = []
    for spec in variables:
        x = samples.values[spec.name]
        failed, ok = x[~samples.ok & np.isfinite(x)], x[samples.ok & np.isfinite(x)]
        if failed.size and ok.size and float(np.ptp(x[np.isfinite(x)])) > 0:
            found.append(_compared(spec, failed, ok))
    return tuple(sorted(found, key=lambda each: (-each.distance, each.p)))


def _compared(spec: VariableSpec, failed: Array, ok: Array) -> FailedAgainstOk:
    a, b = failed[random_rows(failed.size)], ok[random_rows(ok.size)]
    distance = max(largest_distance(a, b), largest_distance(np.abs(a - spec.mean), np.abs(b - spec.mean)))
    root = math.sqrt(a.size * b.size / (a.size + b.size))
    return FailedAgainstOk(
        spec.name,
        float(failed.mean()),
        float(failed.min()),
        float(failed.max()),
        float(ok.mean()),
        float(ok.min()),
        float(ok.max()),
        distance,
        min(2 * float(kolmogorov(distance * root)), 1.0),
    )
