"""Unions of angles about an axis."""

from math import tau

import numpy as np

from engine.arrays import Array

_TOUCHING = 1e-7  # rad between two intervals that count as one


def covered(starts: Array, ends: Array) -> tuple[float, float]:
    """Return the total angle [rad] covered by intervals, and the middle of the covered part.

    `starts` and `ends` [rad] have shape (n,), n >= 1; an end is at or above its start, by less than a turn. The total
    is 2 pi for the full circle; the middle lies midway between the two sides of the largest gap.
    """
    order = np.argsort(starts % tau)
    begin, length = (starts % tau)[order], (ends - starts)[order]
    reach = float((begin + length).max()) - tau  # overlap of intervals past 2 pi with the start
    gaps = []
    for start, extent in zip(begin.tolist(), length.tolist(), strict=True):
        if start > reach + _TOUCHING:
            gaps.append((start - reach, reach))
        reach = max(reach, start + extent)
    if not gaps:
        return tau, 0.0
    widest, since = max(gaps)
    return float(tau - sum(gap for gap, _ in gaps)), float((since + widest + (tau - widest) / 2) % tau)


def perpendicular(axis: Array) -> Array:
    """Return two unit vectors that form a right-handed frame with an axis, shape (2, 3)."""
    first = np.zeros(3)
    # the coordinate axis that is furthest from parallel to the axis, so that the difference below cannot vanish
    first[np.argmin(np.abs(axis))] = 1.0
    first -= axis * (first @ axis)
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(axis, first)])
