"""Surfaces as a file has them, and their signed distances by ways that are not the engine's."""

from typing import Any

import numpy as np

Array = np.ndarray


def knots(count: int, degree: int) -> list[float]:
    """Return even knots from 0 to 1 for a number of control points, with the ends on the first and the last one."""
    inner = np.linspace(0, 1, count - degree + 1)[1:-1]
    return [0.0] * (degree + 1) + inner.tolist() + [1.0] * (degree + 1)


def wavy(nu: int = 18, nv: int = 17, height: float = 0.6) -> dict[str, Any]:
    """Describe a bicubic sheet over 10 by 8 with hills and hollows; by default 210 patches."""
    x, y = np.meshgrid(np.linspace(0, 10, nu), np.linspace(0, 8, nv), indexing="ij")
    control = np.stack([x, y, height * np.sin(x) * np.cos(0.8 * y)], axis=-1)
    return {"degree": [3, 3], "knots_u": knots(nu, 3), "knots_v": knots(nv, 3), "control": control.tolist()}


ARC = np.array([[1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])  # a quarter circle as a rational curve of the second degree
ARC_WEIGHTS = np.array([1.0, np.sqrt(0.5), 1.0])
QUARTER = [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]


def rational(control: Array, weights: Array, **more: Any) -> dict[str, Any]:
    """Describe a rational surface of the second degree with one interval of knots."""
    net = {"control": control.tolist(), "weights": weights.tolist()}
    return {"degree": [2, 2], "knots_u": QUARTER, "knots_v": QUARTER, **net, **more}


def sphere_octant(radius: float, **more: Any) -> dict[str, Any]:
    """Describe an eighth of a sphere about the origin, its normal outside: one edge is the pole."""
    x = np.outer(ARC[:, 0], ARC[:, 0])
    y, z = np.outer(ARC[:, 1], ARC[:, 0]), np.outer(np.ones(3), ARC[:, 1])
    return rational(radius * np.stack([x, y, z], axis=-1), np.outer(ARC_WEIGHTS, ARC_WEIGHTS), **more)


def half_sphere_bowl(radius: float, **more: Any) -> dict[str, Any]:
    """Describe the lower half of a sphere about the origin from the inside, in one surface with a seam and a pole."""
    ring = np.array([[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0]], float)
    weights = np.outer([*np.tile(ARC_WEIGHTS[:2], 4), 1.0], ARC_WEIGHTS)
    x, y = (np.outer(ring[:, k], ARC[:, 0]) for k in (0, 1))
    control = radius * np.stack([x, y, -np.outer(np.ones(9), ARC[:, 1])], axis=-1)
    knots_u = [0.0, *np.repeat([0.0, 0.25, 0.5, 0.75, 1.0], 2).tolist(), 1.0]
    net = {"control": control.tolist(), "weights": weights.tolist()}
    return {"degree": [2, 2], "knots_u": knots_u, "knots_v": QUARTER, **net, **more}


def quarter_cylinder(radius: float, length: float, **more: Any) -> dict[str, Any]:
    """Describe a quarter of a cylinder about the z axis, its normal outside."""
    control = np.array([[[radius * x, radius * y, z] for z in (0, 0.5 * length, length)] for x, y in ARC])
    return rational(control, np.outer(ARC_WEIGHTS, np.ones(3)), **more)


def graded_rectangle(a: float, b: float, patches: tuple[int, int] = (2, 3)) -> Array:
    """Return bicubic patches of the rectangle |x| <= a, |y| <= b in z = 0, (n, 4, 4, 3), unevenly parametrised."""
    t = np.array([0.0, 0.25, 0.6, 1.0])
    cuts = [np.linspace(-side, side, n + 1) for side, n in zip((a, b), patches, strict=True)]
    found = [
        np.stack(np.broadcast_arrays((x0 + (x1 - x0) * t)[:, None], (y0 + (y1 - y0) * t)[None], 0.0), axis=-1)
        for x0, x1 in zip(cuts[0], cuts[0][1:], strict=False)
        for y0, y1 in zip(cuts[1], cuts[1][1:], strict=False)
    ]
    return np.array(found)


def bernstein(t: Array) -> Array:
    """Return the cubic Bernstein polynomials, shape (..., 4)."""
    t = np.asarray(t)[..., None]
    return np.concatenate([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t * t * (1 - t), t**3], axis=-1)


def searched_distance(patches: Array, q: Array) -> float:
    """Return the distance of a point from bicubic patches: a grid of each, and finer ones about eight places."""
    t, around = np.linspace(0, 1, 21), np.linspace(-1, 1, 5)
    squares = np.sum((np.einsum("ai,bj,nijk->nabk", bernstein(t), bernstein(t), patches) - q) ** 2, axis=-1)
    best = np.inf
    for flat in np.argsort(squares.ravel())[:8]:
        n, a, b = np.unravel_index(flat, squares.shape)
        u, v, width = t[a], t[b], 0.05
        for _ in range(60):
            us, vs = np.clip(u + width * around, 0, 1), np.clip(v + width * around, 0, 1)
            points = np.einsum("ai,bj,ijk->abk", bernstein(us), bernstein(vs), patches[n])
            found = np.sum((points - q) ** 2, axis=-1)
            i, j = np.unravel_index(found.argmin(), found.shape)
            u, v, width = us[i], vs[j], 0.7 * width
        best = min(best, float(found.min()))
    return float(np.sqrt(best))
