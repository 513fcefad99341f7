"""How far a point is from triangles."""

import numpy as np

from engine.arrays import Array


def distance_to_triangles(point: Array, corners: Array) -> float:
    """Return the distance from a point to the nearest of some triangles.

    Parameters
    ----------
    point : array
        Shape (3,).
    corners : array
        Shape (n, 3, 3), three corners each; none of them degenerate to a point.

    Returns
    -------
    float
        Infinite if there are no triangles.
    """
    if not len(corners):
        return np.inf
    first, second, third = corners[:, 0], corners[:, 1], corners[:, 2]
    edges = [_to_segments(point, *ends) for ends in ((first, second), (second, third), (third, first))]
    normal = np.cross(second - first, third - first)
    lengths = np.linalg.norm(normal, axis=1)
    height = ((point - first) * normal).sum(axis=1) / np.where(lengths > 0, lengths, 1.0)
    inside = lengths > 0
    for start, end in ((first, second), (second, third), (third, first)):
        inside &= (np.cross(end - start, point - start) * normal).sum(axis=1) >= 0
    return float(np.where(inside, np.abs(height), np.minimum.reduce(edges)).min())


def _to_segments(point: Array, start: Array, end: Array) -> Array:
    """Return the distances from a point to straight segments, shape (n,)."""
    along = end - start
    square = (along**2).sum(axis=1)
    share = ((point - start) * along).sum(axis=1) / np.where(square > 0, square, 1.0)
    nearest = start + np.clip(share, 0.0, 1.0)[:, None] * along
    return np.asarray(np.linalg.norm(point - nearest, axis=1))
