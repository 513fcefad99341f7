"""The forces within Coulomb's cones that balance loads and lie nearest to given ones, if any forces balance them.

Unlike Coulomb's problem this one is convex: minimise |r - r0|^2 / 2 over the r in K with H' r = load. So it is decided
whether loads can be held at all, and the solution is unique. With multipliers w its solution is r = P_K(r0 + H w), P_K
the projection on the cones; the dual problem, to minimise |P_K(r0 + H w)|^2 / 2 - load . w without constraints, is
solved by Newton's method (Qi and Sun, *A nonsmooth version of Newton's method*, 1993) with a line search.
"""

import numpy as np

from engine.arrays import Array

MOST_STEPS = 80
EXACT = 1e-11  # share of the load that may be left over
ENOUGH = 1e-8  # the same, where rounding allows no more
LEAST_DAMPING, DAMPING = 1e-12, 1e-3  # shares of the largest square of H's columns: Newton's matrix is often singular
SLACK = 1e-8  # by which cones are wider: forces on the edge of all of them would be lost to rounding
ARMIJO, HALVINGS = 1e-4, 20


def nearest_balanced(H: Array, load: Array, mu: Array, r0: Array) -> Array | None:
    """Return the forces (N, T1, T2), shape (nc, 3), that balance a load, nearest to ``r0``; None if no forces do.

    ``H``, (3 nc, n), holds what unit forces do to the unknowns, ``load``, (n,), what they have to do together.
    """
    size = float(max(np.linalg.norm(load), np.linalg.norm(r0))) or 1.0
    target, start, w, mu = load / size, r0 / size, np.zeros(load.size), mu * (1 + SLACK)
    shape, scale = (mu.size, 3), float((H * H).sum(axis=0).max(initial=0.0)) or 1.0

    def dual(w: Array) -> tuple[float, Array, Array, Array]:
        r, slope = _project(start + (H @ w).reshape(shape), mu)
        return 0.5 * float((r * r).sum()) - float(target @ w), H.T @ r.ravel() - target, r, slope

    value, left, r, slope = dual(w)
    for _ in range(MOST_STEPS):
        if np.linalg.norm(left) <= EXACT:
            break
        blocks = H.reshape(*shape, -1)
        matrix = np.einsum("cin,cij,cjm->nm", blocks, slope, blocks)
        damping = max(LEAST_DAMPING, DAMPING * min(float(np.linalg.norm(left)), 1.0))  # so that it stays superlinear
        matrix[np.diag_indices_from(matrix)] += damping * scale
        way = np.linalg.solve(matrix, -left)
        step, descent = 1.0, float(left @ way)
        for _ in range(HALVINGS):
            trial = dual(w + step * way)
            if trial[0] <= value + ARMIJO * step * descent:
                break
            step *= 0.5
        else:
            break  # rounding allows no more
        w = w + step * way
        value, left, r, slope = trial
    return size * r if np.linalg.norm(left) <= ENOUGH else None


def _project(r: Array, mu: Array) -> tuple[Array, Array]:
    """Return the nearest forces within the cones, (nc, 3), and the derivatives of the projection, (nc, 3, 3)."""
    N, T = r[:, 0], r[:, 1:]
    size = np.hypot(T[:, 0], T[:, 1])
    inside, polar = (size <= mu * N) & (N >= 0.0), mu * size <= -N
    edge = ~(inside | polar)
    along = T / np.where(size > 0.0, size, 1.0)[:, None]
    s = 1.0 / (1.0 + mu**2)
    normal = np.where(edge, s * (N + mu * size), 0.0)
    out = np.where(inside[:, None], r, 0.0)
    out[edge, 0] = normal[edge]
    out[edge, 1:] = (mu * normal)[edge, None] * along[edge]
    slope = np.zeros((len(mu), 3, 3))
    slope[inside] = np.eye(3)
    # on the edge: onto the generator through the nearest point, and the turning of that generator
    generator = np.concatenate([np.ones((len(mu), 1)), mu[:, None] * along], axis=1)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    turning = mu * normal / np.where(size > 0.0, size, 1.0)
    edges = s[:, None, None] * generator[:, :, None] * generator[:, None, :]
    edges[:, 1:, 1:] += turning[:, None, None] * across[:, :, None] * across[:, None, :]
    slope[edge] = edges[edge]
    return out, slope
