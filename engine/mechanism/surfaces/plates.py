"""Treat a surface with open edges as the top of a plate: the sides and the back of the plate are patches too.

The back is a copy of the surface, with each control point moved against the normal by the depth of the plate. The sides
are ruled surfaces: lines from the points of the open edges to those of the copy. Together the patches bound a solid, so
the signed distance from it is defined everywhere and changes by no more than the displacement of a point.
"""

import numpy as np

from engine.arrays import Array
from engine.mechanism.surfaces.bezier import THIRDS, convex_curvature, normals, points
from engine.mechanism.surfaces.edges import JOINED, MeetingEdges, extent

SHARE_OF_RADIUS = 0.5  # default depth relative to the least radius with which the surface bends away from its normals
SHARE_OF_SIZE = 0.25  # and relative to the surface's size
MOST_OF_RADIUS = 0.9


def default_depth(patches: Array) -> float:
    """Return the default depth of a plate with these patches as its top."""
    curvature = convex_curvature(patches)
    return min(SHARE_OF_SIZE * extent(patches), SHARE_OF_RADIUS / curvature if curvature > 0.0 else np.inf)


def largest_depth(patches: Array) -> float:
    """Return the depth beyond which the back of the plate would fold over."""
    curvature = convex_curvature(patches)
    return MOST_OF_RADIUS / curvature if curvature > 0.0 else np.inf


def plate(patches: Array, meeting: MeetingEdges, depth: float) -> Array:
    """Return patches that bound a plate: those of its top, shape (n, 4, 4, 3), then its sides, then its back."""
    down = -depth * _common_normals(patches)
    back = (patches + down).transpose(0, 2, 1, 3)  # u and v exchanged, so that the normals point out of the back
    below = np.stack([down[:, :, 0], down[:, 3, :], down[:, ::-1, 3], down[:, 0, ::-1]], axis=1)
    top, way = meeting.edges[meeting.is_open], below[meeting.is_open]
    sides = top[:, None] + THIRDS[None, :, None, None] * way[:, None]
    return np.concatenate([patches, sides, back])


def _common_normals(patches: Array) -> Array:
    """Return a direction for each control point: the mean normal of all patches that meet at its surface point."""
    from scipy.spatial import cKDTree  # 0.1 s to load

    own = normals(patches, THIRDS).reshape(-1, 3)
    there = points(patches, THIRDS, THIRDS).reshape(-1, 3)
    pairs = cKDTree(there).query_pairs(JOINED * extent(patches), output_type="ndarray")
    mean = own.copy()
    np.add.at(mean, pairs[:, 0], own[pairs[:, 1]])
    np.add.at(mean, pairs[:, 1], own[pairs[:, 0]])
    length = np.linalg.norm(mean, axis=1, keepdims=True)
    return np.asarray(np.where(length > JOINED, mean / np.where(length > 0.0, length, 1.0), own)).reshape(patches.shape)
