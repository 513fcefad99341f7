"""Values that are equal but for rounding: no sigma, index or histogram is made of the last bits of a constant.

Two computations of one number differ in their last bits, and two runs of a simulation by what its solver leaves open:
a length by the penetration that it tolerates. Values that differ by no more are one value.
"""

import math
from dataclasses import replace

import numpy as np

from reporting.arrays import Array
from reporting.capability.moments import ROUNDING
from reporting.samples import Samples
from reporting.spec import ReportSpec


def leveled_samples(samples: Samples, spec: ReportSpec) -> tuple[Samples, dict[str, float]]:
    """Return the samples with each response that is constant but for rounding made so.

    Parameters
    ----------
    samples : Samples
    spec : ReportSpec
        What the solver resolves of each response.

    Returns
    -------
    (Samples, dict of str to float)
        The samples, and the largest difference that was removed, by response.
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
    return (replace(samples, values=values), removed) if removed else (samples, {})


def leveled(x: Array, resolution: float = 0.0, relative: float = 0.0) -> Array:
    """Return values, or if they differ by rounding only, the same number of their common value.

    Parameters
    ----------
    x : array, shape (n,)
        Finite values.
    resolution : float
        Largest difference that means nothing, in the unit of `x`.
    relative : float
        The same as a share of the largest value; at least `ROUNDING` is taken.

    Returns
    -------
    array, shape (n,)
        `x` itself where values differ by more, or not at all.
    """
    if x.size < 2:
        return x
    low, high = float(x.min()), float(x.max())
    least = max(resolution, max(relative, ROUNDING) * max(abs(low), abs(high)))
    if not 0.0 < high - low <= least:
        return x
    # As many decimals as mean anything: 1.0000000000000002 and its like are 1, and 3e-15 beside a limit of 1e-3 is 0.
    decimals = min(-math.floor(math.log10(least)), 300)
    return np.full(x.size, round(float(np.median(x)), decimals) + 0.0)
