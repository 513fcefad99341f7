"""Control chart of a response: its values in order, or means of them, with control limits and three of Nelson's tests.

Up to 60 independent values are a chart of individuals: sigma is the mean moving range divided by 1.128. More values
are means of equal numbers of consecutive ones: sigma is the pooled one within them, over the root of their number.
Values in production lots are a chart of the lots' means, with sigma from their moving ranges, because lots differ.

The tests are the first three of Nelson (1984, Journal of Quality Technology 16, 237-239): a point beyond three sigma,
nine in a row on one side of the centre, six in a row that rise or fall. A point is marked where its run is complete.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from reporting.arrays import Array
from reporting.capability.lots import independent
from reporting.capability.moments import ROUNDING

MOST_POINTS = 60
_FEWEST_POINTS = 5
_D2 = 2 / math.sqrt(math.pi)  # mean range of two normal values, in sigmas
SIDE, TREND = 9, 6  # points of a run on one side, and of one that rises or falls
# Chance that a point of a stable normal process is marked by each test; six values rise in one of 720 orders.
_BY_CHANCE = (0.0027, 2 * 0.5**SIDE, 2 / math.factorial(TREND))


@dataclass(frozen=True)
class ControlChart:
    """Values of a response in order, or means of them, and what the tests mark."""

    points: tuple[float, ...]  # in the response's unit
    of: str  # "values", "means" of consecutive values, or "lots": their means
    size: int  # fewest values, or lots, in a point
    centre: float
    low: float  # control limits
    high: float
    beyond: tuple[int, ...]  # numbers of the points beyond the control limits, from 0
    one_side: tuple[int, ...]  # of those that complete nine or more on one side of the centre
    trend: tuple[int, ...]  # of those that complete six or more that rise or fall
    by_chance: float  # expected number of marked points if nothing changes

    @property
    def marked(self) -> tuple[int, ...]:
        """Numbers of all marked points, in order."""
        return tuple(sorted({*self.beyond, *self.one_side, *self.trend}))


def control_chart(x: Array, lots: NDArray[np.generic] | None = None) -> ControlChart | None:
    """Return the control chart of finite values in their order; None below 5 points, or without spread.

    `lots`, shape (n,), are the lots of the values; None for independent values.
    """
    if x.size < _FEWEST_POINTS or float(np.ptp(x)) <= ROUNDING * float(np.max(np.abs(x))):
        return None
    if lots is not None and not independent(lots):
        points, size = _thinned(_lot_means(x, lots))
        of, sigma = "lots", _of_moving_ranges(points)
    elif x.size <= MOST_POINTS:
        points, of, size = x, "values", 1
        sigma = _of_moving_ranges(points)
    else:
        size = _round_size(x.size)
        groups = np.array_split(x, x.size // size)
        points, of = np.array([group.mean() for group in groups]), "means"
        within = sum(float(np.sum((group - group.mean()) ** 2)) for group in groups) / (x.size - len(groups))
        sigma = math.sqrt(within / size)
    if points.size < _FEWEST_POINTS or not sigma > 0:
        return None
    centre = float(x.mean()) if of != "lots" else float(points.mean())
    low, high = centre - 3 * sigma, centre + 3 * sigma
    side, steps = np.sign(points - centre), np.sign(np.diff(points))
    return ControlChart(
        points=tuple(points.tolist()),
        of=of,
        size=size,
        centre=centre,
        low=low,
        high=high,
        beyond=tuple(np.flatnonzero((points < low) | (points > high)).tolist()),
        one_side=_ends_of_runs(side, SIDE),
        trend=tuple(end + 1 for end in _ends_of_runs(steps, TREND - 1)),
        by_chance=sum(
            chance * max(points.size - needed + 1, 0)
            for chance, needed in zip(_BY_CHANCE, (1, SIDE, TREND), strict=True)
        ),
    )


def _lot_means(x: Array, lots: NDArray[np.generic]) -> Array:
    """Return the mean of each lot, in the order of the lots."""
    _, number = np.unique(lots, return_inverse=True)
    means: Array = np.bincount(number, x) / np.bincount(number)
    return means


def _thinned(points: Array) -> tuple[Array, int]:
    """Return at most 60 means of consecutive points, and how many at least are in one."""
    if points.size <= MOST_POINTS:
        return points, 1
    size = _round_size(points.size)
    return np.array([group.mean() for group in np.array_split(points, points.size // size)]), size


def _round_size(n: int) -> int:
    """Return the smallest number 1, 2 or 5 times a power of ten by which n values make at most 60 points."""
    power = 1
    while True:
        for factor in (1, 2, 5):
            if n <= MOST_POINTS * factor * power:
                return factor * power
        power *= 10


def _of_moving_ranges(points: Array) -> float:
    """Return sigma from the mean moving range of two."""
    return float(np.mean(np.abs(np.diff(points)))) / _D2 if points.size > 1 else 0.0


def _ends_of_runs(signs: Array, length: int) -> tuple[int, ...]:
    """Return where at least `length` equal signs other than 0 in a row are complete."""
    ends, count, last = [], 0, 0.0
    for at, sign in enumerate(signs.tolist()):
        count = count + 1 if sign == last and sign else int(sign != 0)
        last = sign
        if count >= length:
            ends.append(at)
    return tuple(ends)
