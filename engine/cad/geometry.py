"""Angles about an axis, frames across it, and distances of points from triangles."""

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


def distance_to_triangles(point: Array, corners: Array) -> float:
    """Return the distance from a point to the nearest triangle, corners (n, 3, 3), none a point; infinite if n is 0."""
    return float(np.linalg.norm(nearest_on_triangles(point, corners)[0] - point)) if len(corners) else np.inf


def nearest_on_triangles(point: Array, corners: Array) -> tuple[Array, int]:
    """Return the nearest point on triangles, corners (n, 3, 3), n >= 1, none a point, and the row of its triangle."""
    first, second, third = corners[:, 0], corners[:, 1], corners[:, 2]
    sides = (first, second), (second, third), (third, first)
    normal = np.cross(second - first, third - first)
    square = (normal**2).sum(axis=1)
    inside = square > 0
    for start, end in sides:
        inside &= (np.cross(end - start, point - start) * normal).sum(axis=1) >= 0
    height = ((point - first) * normal).sum(axis=1) / np.where(square > 0, square, 1.0)
    places = np.array([point - height[:, None] * normal, *(_on_segments(point, *ends) for ends in sides)])
    away = np.linalg.norm(places - point, axis=2)
    away[0][~inside] = np.inf
    way, row = np.unravel_index(int(away.argmin()), away.shape)
    return np.asarray(places[way, row]), int(row)


def _on_segments(point: Array, start: Array, end: Array) -> Array:
    """Return the nearest points on straight segments, shape (n, 3)."""
    along = end - start
    square = (along**2).sum(axis=1)
    share = ((point - start) * along).sum(axis=1) / np.where(square > 0, square, 1.0)
    return np.asarray(start + np.clip(share, 0.0, 1.0)[:, None] * along)
