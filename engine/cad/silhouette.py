"""The outline of a part seen along a direction, for pictures."""

from math import ceil

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import KDTree

from engine.arrays import Array
from engine.cad.cad_model import TriangleMesh
from engine.cad.geometry import perpendicular

_PIXELS = 500  # along the longer side
_STRAIGHT = 1.0  # pixels between the outline and its simplification
_NEAR = 2.5  # pixels between a corner of the outline and the vertex it is moved to
_TURNS = ((0, 1), (-1, 0), (0, -1), (1, 0))  # steps along the border of a pixel, each turned left from the previous one
_EVERYWHERE = np.ones((3, 3))


def silhouette(mesh: TriangleMesh, direction: Array) -> list[Array]:
    """Return the outlines of a part, without hidden lines inside them, the largest first.

    The edges of the triangles are drawn on a grid, the enclosed area is filled, and its border is followed. The corners
    of the outline are vertices of the mesh; in between it deviates by at most 1/500 of the part's size.

    The direction is a unit vector, shape (3,). Each outline has shape (n, 3), does not repeat its first corner, and
    lies in the plane perpendicular to the direction through the middle of the part; there is none if the mesh is empty.
    """
    if not len(mesh.triangles):
        return []
    frame = perpendicular(direction)
    flat = mesh.vertices @ frame.T
    low, size = flat.min(axis=0), float(np.ptp(flat, axis=0).max())
    pixel = size / _PIXELS
    filled = ndimage.binary_fill_holes(_drawn((flat - low) / pixel, mesh))
    pieces, count = ndimage.label(filled, _EVERYWHERE)
    order = np.argsort([-np.count_nonzero(pieces == piece) for piece in range(1, count + 1)]) + 1
    vertices = KDTree(flat)
    height = float((mesh.vertices @ direction).min() + (mesh.vertices @ direction).max()) / 2
    outlines = []
    for piece in order.tolist():
        # `_drawn` leaves an empty frame of two pixels
        corners = low + (_straightened(_border(pieces == piece)) - 2.0) * pixel
        far, nearest = vertices.query(corners)
        snapped = np.where((far < _NEAR * pixel)[:, None], flat[nearest], corners)
        different = np.linalg.norm(snapped - np.roll(snapped, 1, axis=0), axis=1) > 0
        outlines.append(snapped[different] @ frame + height * direction)
    return outlines


def _drawn(points: Array, mesh: TriangleMesh) -> NDArray[np.bool_]:
    """Return the pixels that edges of triangles pass through, with an empty frame of two pixels around them."""
    sides = np.concatenate([mesh.triangles[:, pair] for pair in ([0, 1], [1, 2], [2, 0])])
    sides = np.unique(np.sort(sides, axis=1), axis=0)
    starts, ends = points[sides[:, 0]], points[sides[:, 1]]
    # at least two points for each pixel of length: a hole in a line would keep its area from being filled
    counts = 2 * np.ceil(np.linalg.norm(ends - starts, axis=1)).astype(np.int64) + 2
    owner = np.repeat(np.arange(len(sides)), counts)
    part = (np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)) / (counts[owner] - 1)
    passed = np.floor(starts[owner] + part[:, None] * (ends - starts)[owner]).astype(np.int64) + 2
    drawn = np.zeros([ceil(extent) + 5 for extent in points.max(axis=0)], np.bool_)
    drawn[passed[:, 0], passed[:, 1]] = True
    return drawn


def _border(filled: NDArray[np.bool_]) -> Array:
    """Return the corners of the pixels along the outer border of a filled piece, counter-clockwise, shape (n, 2)."""
    row, column = np.argwhere(filled)[0]
    start = at = (int(row), int(column))
    way, corners = 3, [at]  # start along the lowest row, with the piece on the left
    while True:
        at = (at[0] + _TURNS[way][0], at[1] + _TURNS[way][1])
        if at == start:
            return np.array(corners, np.float64)
        corners.append(at)
        left, right = _ahead(filled, at, way)
        way = way if left and not right else (way - 1) % 4 if right else (way + 1) % 4


def _ahead(filled: NDArray[np.bool_], at: tuple[int, int], way: int) -> tuple[bool, bool]:
    """Return whether the pixels ahead of a corner, left and right of the direction of travel, are filled."""
    row, column = at
    ahead = {
        0: ((row - 1, column), (row, column)),
        1: ((row - 1, column - 1), (row - 1, column)),
        2: ((row, column - 1), (row - 1, column - 1)),
        3: ((row, column), (row, column - 1)),
    }
    left, right = ahead[way]
    return bool(filled[left]), bool(filled[right])


def _straightened(corners: Array) -> Array:
    """Return the corners needed to stay close to all of them (Douglas and Peucker 1973)."""
    far = int(np.argmax(np.linalg.norm(corners - corners[0], axis=1)))
    closed = np.vstack([corners, corners[:1]])
    needed, open_pieces = {0, far}, [(0, far), (far, len(corners))]
    while open_pieces:
        first, last = open_pieces.pop()
        chord = closed[last] - closed[first]
        away = closed[first : last + 1] - closed[first]
        off = np.abs(chord[0] * away[:, 1] - chord[1] * away[:, 0]) / max(float(np.linalg.norm(chord)), 1e-300)
        middle = first + int(np.argmax(off))
        if off.max() > _STRAIGHT and first < middle < last:
            needed.add(middle)
            open_pieces += [(first, middle), (middle, last)]
    return corners[sorted(needed)]
