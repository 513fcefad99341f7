"""How the edges of patches meet: which are shared, which are open, and which patches have opposite normals."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from engine.arrays import Array
from engine.mechanism.surfaces.bezier import basis, directed_edges

JOINED = 1e-6  # share of the surface's size: control points closer together than this coincide
SAMPLES = 129  # points per edge in the search for other edges along it


@dataclass(frozen=True)
class MeetingEdges:
    """The edges of patches, four per patch, see `bezier.directed_edges`."""

    edges: Array  # (n, 4, 4, 3) control points
    is_open: NDArray[np.bool_]  # (n, 4) no other patch shares it; an edge collapsed to a point is not open
    is_loose: NDArray[np.bool_]  # (n, 4) it runs along others without coinciding with them
    opposed: list[tuple[int, int]]  # patches that share an edge and have normals on opposite sides


def meeting_edges(patches: Array) -> MeetingEdges:
    """Find the edges that patches, shape (n, 4, 4, 3), share."""
    from scipy.spatial import cKDTree  # 0.1 s to load

    edges = directed_edges(patches)
    flat, size = edges.reshape(-1, 4, 3), extent(patches)
    near = JOINED * size
    long = np.linalg.norm(flat - flat[:, :1], axis=2).max(axis=1) > near
    # a patch is on the left of its edges, so its neighbour's edge runs the other way if their normals agree
    tree = cKDTree(flat.reshape(-1, 12))
    reach = 2 * near  # covers an edge, whose four points each match within `near`
    turned = tree.query_ball_point(flat[:, ::-1].reshape(-1, 12), reach)
    same = tree.query_ball_point(flat.reshape(-1, 12), reach)
    opposed = sorted({(i // 4, j // 4) for i, found in enumerate(same) if long[i] for j in found if j // 4 > i // 4})
    alone = long & np.array([not set(found) - {i} for i, found in enumerate(turned)])
    is_open = alone.copy()
    is_open[alone] = ~_along_others(flat, np.flatnonzero(alone), long)
    return MeetingEdges(edges, is_open.reshape(-1, 4), (alone & ~is_open).reshape(-1, 4), opposed)


def extent(patches: Array) -> float:
    """Return the longest side of the bounding box of all control points."""
    return float(np.ptp(patches.reshape(-1, 3), axis=0).max())


def _along_others(edges: Array, which: NDArray[np.int64], long: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which edges lie along others, as a part of them or containing them."""
    from scipy.spatial import cKDTree

    candidates = np.flatnonzero(long)
    samples = np.einsum("ai,nij->naj", basis(np.linspace(0, 1, SAMPLES))[0], edges[candidates])
    spacing = np.linalg.norm(np.diff(samples, axis=1), axis=2).max(axis=1)
    tree = cKDTree(samples.reshape(-1, 3))
    found = np.ones(len(which), bool)
    for k, i in enumerate(which):
        for p in np.einsum("ai,ij->aj", basis(np.array([0.21, 0.5, 0.79]))[0], edges[i]):
            others = np.unique(np.array(tree.query_ball_point(p, spacing.max()), np.int64) // SAMPLES)
            near = [
                np.linalg.norm(samples[other] - p, axis=1).min() <= 0.6 * spacing[other]
                for other in others
                if candidates[other] != i
            ]
            found[k] &= any(near)
    return found
