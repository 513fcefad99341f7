"""Intervals of capability indices without a normal distribution, from the intervals of mean and sigma.

An index depends on the mean and on sigma. The distance from the index to each end of its interval is the root of the
sum of the squared distances that follow from the intervals of mean and sigma alone, with the covariance of their errors
(Zou and Donner 2008, "method of variance estimates recovery"). For normal values this is the normal-theory interval to
a few thousandths of its width.
"""

import math
import sys

from reporting.capability.indices import point_indices
from reporting.capability.intervals import Interval, bench_slopes
from reporting.capability.precision import Precision

IntervalByName = dict[str, Interval | None]


def robust_intervals(
    precision: Precision, lsl: float | None, usl: float | None, target: float | None
) -> IntervalByName:
    """Return the intervals of mean, sigma and all indices; None where a limit or the target is missing."""
    mean, half = precision.mean, precision.mean_half
    index, sides = point_indices(mean, precision.std, lsl, usl), _sides(precision, lsl, usl)
    nearer = min((name for name in sides if index[name] is not None), key=lambda name: index[name] or 0.0, default="")
    intervals: IntervalByName = {
        "mean_interval": (mean - half, mean + half),
        "std_interval": precision.std_interval,
        "cpl_interval": sides.get("cpl"),
        "cpu_interval": sides.get("cpu"),
        "cpk_interval": sides.get(nearer),
        "z_bench_interval": _bench(precision, lsl, usl),
    }
    if lsl is not None and usl is not None:
        low, high = precision.std_interval
        centre, width = (usl + lsl) / 2, usl - lsl
        intervals["cp_interval"] = (width / (6 * high), width / (6 * low))
        intervals["cc_interval"] = (2 * (mean - half - centre) / width, 2 * (mean + half - centre) / width)
        intervals["cpm_interval"] = None if target is None else _cpm(precision, width, target)
    return intervals


def joint_interval(precision: Precision, wider: Precision, lsl: float | None, usl: float | None) -> Interval | None:
    """Return an interval of Cpk that is valid wherever the mean lies; with one limit, the interval of that side.

    Cpk is at least the smaller of the lower ends of both sides if the lower end of its own side is correct. It is at
    most the smaller of the upper ends if both are correct, so each may fail only half as often (Bonferroni): `wider`
    has the confidence ``(1 + confidence) / 2``.
    """
    sides = _sides(precision, lsl, usl)
    if not sides:
        return None
    above = sides if len(sides) == 1 else _sides(wider, lsl, usl)
    return min(low for low, _ in sides.values()), min(high for _, high in above.values())


def _sides(precision: Precision, lsl: float | None, usl: float | None) -> dict[str, Interval]:
    """Return the intervals of Cpl and Cpu, as far as the limits exist."""
    found = {}
    if lsl is not None:
        found["cpl"] = _side(precision, (precision.mean - lsl) / (3 * precision.std), rises=True)
    if usl is not None:
        found["cpu"] = _side(precision, (usl - precision.mean) / (3 * precision.std), rises=False)
    return found


def _side(precision: Precision, index: float, *, rises: bool) -> Interval:
    """Return the interval of Cpl, which increases with the mean, or of Cpu, which decreases."""
    of_mean = precision.mean_half / (3 * precision.std) * (1 if rises else -1)
    return _combined(precision, index, of_mean, index)


def _bench(precision: Precision, lsl: float | None, usl: float | None) -> Interval | None:
    """Return the interval of Z.bench; its derivative with respect to the Z of a side is the ratio of the densities."""
    z_lsl = None if lsl is None else (precision.mean - lsl) / precision.std
    z_usl = None if usl is None else (usl - precision.mean) / precision.std
    slopes = bench_slopes(z_lsl, z_usl)
    if slopes is None:
        return None
    z, of_lsl, of_usl = slopes
    of_mean = (of_lsl - of_usl) * precision.mean_half / precision.std
    return _combined(precision, z, of_mean, of_lsl * (z_lsl or 0.0) + of_usl * (z_usl or 0.0))


def _combined(precision: Precision, value: float, of_mean: float, over_sigma: float) -> Interval:
    """Return the interval of an index that changes by `of_mean` with the mean and has a part proportional to 1 / sigma.

    `of_mean` is its change when the mean rises to the upper end of its interval; `over_sigma` is the part proportional
    to 1 / sigma, for Cpl and Cpu the whole index.
    """
    low, high = precision.std_interval
    moves = sorted((over_sigma * (precision.std / high - 1), over_sigma * (precision.std / low - 1)))
    # Directions in which the index moves when an error raises the mean, and when one raises sigma.
    together = 2 * precision.correlation * math.copysign(1, of_mean) * -math.copysign(1, over_sigma)
    # Products, not powers: a power of Python floats raises an error on overflow, a product is infinite.
    below, above = (
        math.sqrt(max(of_mean * of_mean + move * move + together * abs(of_mean * move), 0.0)) for move in moves
    )
    return value - below, value + above


def _cpm(precision: Precision, width: float, target: float) -> Interval:
    """Return the interval of Cpm from that of the mean square around the target: variance plus squared offset."""
    # In units of the largest distance from the target, so that squares neither overflow nor underflow.
    offset, unit = precision.mean - target, max(precision.std_interval[1], abs(precision.mean - target))
    std, offset, half = precision.std / unit, offset / unit, precision.mean_half / unit
    low, high = (end / unit for end in precision.std_interval)
    square = std**2 + offset**2
    together = 2 * precision.correlation * math.copysign(1, offset)

    def distance(of_sigma: float, of_mean: float) -> float:
        return math.sqrt(max(of_sigma**2 + of_mean**2 + together * of_sigma * of_mean, 0.0))

    nearest, farthest = max(abs(offset) - half, 0.0), abs(offset) + half
    above = square + distance(high**2 - std**2, farthest**2 - offset**2)
    below = max(square - distance(std**2 - low**2, offset**2 - nearest**2), low**2, sys.float_info.min)
    return width / unit / (6 * math.sqrt(above)), width / unit / (6 * math.sqrt(below))
