"""Bicubic Bezier patches as arrays of control points, shape (n, 4, 4, 3), and the surfaces and plates they make up.

An outward normal is dS/du x dS/dv.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from engine.arrays import Array, Integers

THIRDS = np.linspace(0.0, 1.0, 4)
NEARLY_FLAT = 1e-7  # a cross product shorter than this share of a patch's squared size has no direction
INWARD = 1e-4  # share of a patch: step towards its middle from an edge collapsed to a point

JOINED = 1e-6  # share of the surface's size: control points closer together than this coincide
SAMPLES = 129  # points per edge in the search for other edges along it

BORDER = np.array([[i in (0, 3) or j in (0, 3) for j in range(4)] for i in range(4)])
ALONG_EDGE = np.linspace(0.0, 1.0, 33)  # parameters along an edge
ACROSS = 6  # number of closest samples, at least one of which lies on another edge
RIGHT_ANGLE = 1e-9  # two normals with a smaller cosine are more than 90 degrees apart

SHARE_OF_RADIUS = 0.5  # default depth relative to the least radius with which the surface bends away from its normals
SHARE_OF_SIZE = 0.25  # and relative to the surface's size
MOST_OF_RADIUS = 0.9


def basis(t: Array) -> Array:
    """Return the cubic Bernstein polynomials, with first and second derivatives, at ``t``, shape (m,): (3, m, 4)."""
    t = np.asarray(t, float)[:, None]
    s = 1 - t
    zero = 0 * t
    value = [s**3, 3 * s * s * t, 3 * s * t * t, t**3]
    first = [-3 * s * s, 3 * s * (s - 2 * t), 3 * t * (2 * s - t), 3 * t * t]
    second = [6 * s, 6 * (t - 2 * s), 6 * (s - 2 * t), 6 * t + zero]
    return np.array([np.hstack(part) for part in (value, first, second)])


def points(patches: Array, u: Array, v: Array, by_u: int = 0, by_v: int = 0) -> Array:
    """Return points, or derivatives up to the second, of all patches on a parameter grid: (n, len(u), len(v), 3)."""
    return np.asarray(np.einsum("ai,bj,nijk->nabk", basis(u)[by_u], basis(v)[by_v], patches))


def normals(patches: Array, t: Array) -> Array:
    """Return the unit normals on a parameter grid, (n, len(t), len(t), 3); at a collapsed edge, their limits."""
    n = _products(patches, t)
    length = np.linalg.norm(n, axis=-1)
    size = np.ptp(patches, axis=(1, 2)).max(axis=-1)
    flat = length <= NEARLY_FLAT * size[:, None, None] ** 2
    if flat.any():
        n = np.where(flat[..., None], _products(patches, INWARD + (1 - 2 * INWARD) * np.asarray(t)), n)
        length = np.linalg.norm(n, axis=-1)
    return np.asarray(n / np.where(length > 0.0, length, 1.0)[..., None])


def _products(patches: Array, t: Array) -> Array:
    return np.cross(points(patches, t, t, 1, 0), points(patches, t, t, 0, 1))


def convex_curvature(patches: Array) -> float:
    """Return the largest curvature, over a grid of each patch, of bending away from outward normals; 0 if none does."""
    t = np.linspace(0.05, 0.95, 7)
    S_u, S_v = points(patches, t, t, 1, 0), points(patches, t, t, 0, 1)
    n = normals(patches, t)
    L, M, N = (
        -np.sum(points(patches, t, t, *by) * n, axis=-1) for by in ((2, 0), (1, 1), (0, 2))
    )  # positive: away from the normal
    E, F, G = np.sum(S_u * S_u, axis=-1), np.sum(S_u * S_v, axis=-1), np.sum(S_v * S_v, axis=-1)
    area = E * G - F * F
    size = np.ptp(patches, axis=(1, 2)).max(axis=-1)[:, None, None]
    counts = area > (1e-4 * size * size) ** 2
    area = np.where(counts, area, 1.0)
    mean = 0.5 * (E * N - 2 * F * M + G * L) / area
    gauss = (L * N - M * M) / area
    largest = mean + np.sqrt(np.maximum(mean * mean - gauss, 0.0))
    return float(np.max(np.where(counts, largest, 0.0), initial=0.0))


def directed_edges(patches: Array) -> Array:
    """Return the control points of the four edges of each patch, shape (n, 4, 4, 3), with the patch on their left side.

    Seen from outside, they follow the boundary of the patch: v = 0, u = 1, v = 1, u = 0.
    """
    P = patches
    return np.stack([P[:, :, 0], P[:, 3, :], P[:, ::-1, 3], P[:, 0, ::-1]], axis=1)


def mean_direction(patches: Array) -> tuple[Array, Array]:
    """Return the mean of a surface's control points and the unit vector of its mean normal; z if it has none."""
    middle = patches.reshape(-1, 3).mean(axis=0)
    t = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3)  # exact for quadratic functions
    area = _products(patches, t).sum(axis=(0, 1, 2))
    length = float(np.linalg.norm(area))
    size = float(np.linalg.norm(_products(patches, t), axis=-1).sum())
    return middle, area / length if length > 1e-6 * size else np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class MeetingEdges:
    """The edges of patches, four per patch, see `directed_edges`."""

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


# Join the patches of several faces into one surface: common edges get the same control points, sharp gaps are found.
#
# At an edge between two faces the closest point of a surface lies on both, and the two normals together tell on which
# side of the surface a point is. If there is a gap between the faces, however small, the closest point lies on only one
# of them, and its normal tells the side correctly only where the two normals are less than 90 degrees apart.


def joined_faces(faces: Sequence[Array]) -> tuple[Array, list[float]]:
    """Return the patches of faces, (n, 4, 4, 3) each, in one array, with common control points where borders meet.

    The second result is the largest displacement of a control point of each face [length].
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree  # 0.1 s to load

    patches = np.concatenate(faces)
    border = patches[:, BORDER].reshape(-1, 3)
    pairs = cKDTree(border).query_pairs(JOINED * extent(patches), output_type="ndarray")
    links = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(border),) * 2)
    count, group = connected_components(links, directed=False)
    members = np.bincount(group, minlength=count)
    means = np.stack([np.bincount(group, border[:, k], count) for k in range(3)], axis=1) / members[:, None]
    met = np.where(members[group, None] > 1, means[group], border)
    far = np.linalg.norm(met - border, axis=1).reshape(len(patches), -1).max(axis=1)
    patches[:, BORDER] = met.reshape(len(patches), -1, 3)
    ends = np.cumsum([len(face) for face in faces])[:-1]
    return patches, [float(each.max()) for each in np.split(far, ends)]


def sharp_gap(patches: Array, meeting: MeetingEdges) -> tuple[int, int] | None:
    """Return two patches that meet without a common edge, with normals more than 90 degrees apart; None if none do."""
    from scipy.spatial import cKDTree  # 0.1 s to load

    loose = np.argwhere(meeting.is_loose)
    if not len(loose):
        return None
    points = np.einsum("ai,nij->naj", basis(ALONG_EDGE)[0], meeting.edges[meeting.is_loose]).reshape(-1, 3)
    own = _along_edges(patches, loose).reshape(-1, 3)
    edge = np.repeat(np.arange(len(loose)), len(ALONG_EDGE))
    _, near = cKDTree(points).query(points, k=min(ACROSS, len(points)))
    other = edge[near] != edge[:, None]
    nearest = near[np.arange(len(points)), other.argmax(axis=1)]
    sharp = other.any(axis=1) & (np.sum(own * own[nearest], axis=1) < -RIGHT_ANGLE)
    if not sharp.any():
        return None
    first = int(sharp.argmax())
    return int(loose[edge[first], 0]), int(loose[edge[nearest[first]], 0])


def _along_edges(patches: Array, which: Integers) -> Array:
    """Return the normals along edges of patches, given as rows (patch, edge), at the samples: (n, samples, 3)."""
    found = normals(patches[which[:, 0]], ALONG_EDGE)
    each = np.stack([found[:, :, 0], found[:, -1, :], found[:, ::-1, -1], found[:, 0, ::-1]], axis=1)
    return np.asarray(each[np.arange(len(which)), which[:, 1]])


# Treat a surface with open edges as the top of a plate: the sides and the back of the plate are patches too.
#
# The back is a copy of the surface, with each control point moved against the normal by the depth of the plate. The
# sides are ruled surfaces: lines from the points of the open edges to those of the copy. Together the patches bound a
# solid, so the signed distance from it is defined everywhere and changes by no more than the displacement of a point.


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
