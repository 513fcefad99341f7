"""Values that differ by rounding only: no sigma, index or histogram is computed from the last bits of a constant.

Two computations of the same number differ in their last bits, and two runs of a simulation differ within the
tolerances of its solver: a length by the tolerated penetration. Values that differ by no more are treated as one value.
"""

import math
from dataclasses import replace

import numpy as np

from reporting.arrays import Array
from reporting.capability.moments import ROUNDING
from reporting.samples import SMALLEST, Samples
from reporting.spec import ReportSpec


def leveled_samples(samples: Samples, spec: ReportSpec) -> tuple[Samples, dict[str, float]]:
    """Return the samples, and the largest removed difference by response.

    A response that is constant except for rounding is replaced by its common value; the spec has the resolution of
    each.
    """
    values, removed = dict(samples.values), dict[str, float]()
    for response in spec.responses:
        rows = samples.ok & np.isfinite(values[response.name])
        x = values[response.name][rows]
        one = leveled(x, response.resolution, response.relative_resolution)
        if one is not x:
            removed[response.name] = float(np.ptp(x))
            column = values[response.name].copy()
            column[rows] = one
            values[response.name] = column
    for variable in spec.variables:
        x = values[variable.name]
        if 0.0 < np.nanmax(x, initial=-np.inf) - np.nanmin(x, initial=np.inf) <= SMALLEST:
            values[variable.name] = np.where(np.isnan(x), x, np.nanmedian(x))
    return replace(samples, values=values), removed


def leveled(x: Array, resolution: float = 0.0, relative: float = 0.0) -> Array:
    """Return the finite values, or an array of their common value if they differ by rounding only.

    `resolution`, in the unit of `x`, and `relative`, a share of the largest value, are the largest meaningless
    differences; the latter is at least `ROUNDING`. `x` itself is returned if its values differ by more, or not at all.
    """
    if x.size < 2:
        return x
    low, high = float(x.min()), float(x.max())
    negligible = max(resolution, max(relative, ROUNDING) * max(abs(low), abs(high)), SMALLEST)
    if not 0.0 < high - low <= negligible:
        return x
    # Keep only meaningful decimals: 1.0000000000000002 becomes 1, and 3e-15 beside a limit of 1e-3 becomes 0.
    decimals = min(-math.floor(math.log10(negligible)), 300)
    return np.full(x.size, round(float(np.median(x)), decimals) + 0.0)
