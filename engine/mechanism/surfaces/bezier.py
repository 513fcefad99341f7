"""Bicubic Bezier patches as arrays of control points, shape (n, 4, 4, 3); an outward normal is dS/du x dS/dv."""

import numpy as np

from engine.arrays import Array

THIRDS = np.linspace(0.0, 1.0, 4)
NEARLY_FLAT = 1e-7  # a cross product shorter than this share of a patch's squared size has no direction
INWARD = 1e-4  # share of a patch: step towards its middle from an edge collapsed to a point


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
    """Return the largest curvature with which patches bend away from their outward normals; 0 if none does.

    It is the maximum over a grid of each patch; points without a normal are ignored.
    """
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
