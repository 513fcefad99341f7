"""What the values cannot show: a small second population, wider than the rest or shifted, with a share out of limits.

A mechanism may behave in another way in a few of a thousand assemblies: another contact, a stop that is reached. If a
share e of production comes from a population of which a part p lies outside the range of the n values, the values have
none of these with the probability (1 - e p)^n. Shares for which that is below 5 % are excluded; the largest share that
is not, at most `MOST`, is assumed where a verdict claims to be certain. A second population of less than `LEAST` is
never assumed: plain samples cannot exclude it at a reasonable cost, and the page says so. Weighted runs can.
"""

import math

import numpy as np
from scipy.special import ndtr

from reporting.arrays import Array
from reporting.capability.shares import PPM
from reporting.capability.verdict import SecondPopulation
from reporting.format_numbers import grouped, part, ppm

LEAST, MOST = 0.002, 0.05  # shares of production
_MISSED = 0.05  # probability of values without any of the second population
# Centre and sigma of the second population, in sigmas of the values.
_WIDER = ((0.0, 3.0), (0.0, 5.0))
_SHIFTED = tuple((sign * shift, 1.0) for sign in (-1.0, 1.0) for shift in (4.0, 6.0, 8.0))
ASSUMES = (
    f"Certain provided that less than {part(LEAST)} of production is a second population, up to five times as wide "
    "or shifted by up to 8σ; these samples do not exclude a smaller one."
)


def second_population(x: Array, lsl: float | None, usl: float | None, worth: float) -> SecondPopulation | None:
    """Return the worst second population that the values permit, which are worth this many independent ones.

    It has no share beyond a limit if they exclude every such population. None if they are equal.
    """
    mean, std = float(np.mean(x)), float(np.std(x))
    if not std > 0 or not math.isfinite(std):
        return None
    low, high = (float(end) for end in ((x.min() - mean) / std, (x.max() - mean) / std))
    found = SecondPopulation(0.0, "", ASSUMES)
    for centre, sigma in (*_WIDER, *_SHIFTED):
        outside = float(ndtr((low - centre) / sigma) + ndtr((centre - high) / sigma))
        possible = min(-math.log(_MISSED) / (worth * outside), MOST) if outside > 0 else MOST
        if possible < LEAST:
            continue
        beyond = max(
            0.0 if lsl is None else float(ndtr(((lsl - mean) / std - centre) / sigma)),
            0.0 if usl is None else float(ndtr((centre - (usl - mean) / std) / sigma)),
        )
        if PPM * possible * beyond > found.ppm:
            kind = f"{sigma:g} times as wide" if centre == 0 else f"shifted by {abs(centre):g}σ"
            words = (
                f"{grouped(x.size)} values do not rule out that {part(possible)} of production is a second population "
                f"{kind}, with {ppm(PPM * possible * beyond)} ppm beyond a limit"
            )
            found = SecondPopulation(PPM * possible * beyond, words, ASSUMES)
    return found
