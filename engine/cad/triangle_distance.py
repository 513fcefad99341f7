"""The distance of a point from triangles, and the nearest point on them."""

import numpy as np

from engine.arrays import Array


def distance_to_triangles(point: Array, corners: Array) -> float:
    """Return the distance from a point to the nearest triangle, corners (n, 3, 3); infinite if there are none.

    None of the triangles is degenerate to a point.
    """
    return float(np.linalg.norm(nearest_on_triangles(point, corners)[0] - point)) if len(corners) else np.inf


def nearest_on_triangles(point: Array, corners: Array) -> tuple[Array, int]:
    """Return the nearest point on triangles, corners (n, 3, 3), n >= 1, and the row of its triangle.

    None of the triangles is degenerate to a point.
    """
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
