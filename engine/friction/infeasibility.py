"""A proof that a friction problem has no solution: impulses that balance each other and yet oppose every motion.

Coulomb's law requires a velocity with u_N >= 0 at each contact. By Farkas' lemma there is none if and only if there are
weights p >= 0, not all zero, with H_N' p = 0 (apart from what bilateral rows hold) and p . q_N < 0: the contacts with
p > 0 squeeze what lies between them. Whatever the bodies do, the mean approach weighted by p remains. The weights are
found as Lawson and Hanson solve a least-distance problem (Solving Least Squares Problems, chapter 23): the p >= 0 that
minimises |H_N' p|^2 + (1 + q_N . p)^2 balances if no velocity fits; otherwise it yields the smallest velocity.
"""

import numpy as np

from engine.arrays import Array
from engine.platform.linear_algebra import nonnegative_least_squares

# With rounded numbers no balance is exact. A remainder e = H_N' p still proves that any fitting velocity is at least
# p . (-q_N) / |e|. If this is less than ENDLESS times the velocity that a single contact requires, there may be one.
ENDLESS = 3e9
SURE = 1e-9  # share of the largest relative velocity: a slower mean approach may be a rounding error
ROUNDING = 1e-12  # share of a row: a smaller remainder beside the bilateral rows is a rounding error


def squeezing_impulses(rows: Array, q: Array, speed: float, held: Array | None = None) -> Array | None:
    """Return impulses proving that no velocity w satisfies rows w + q >= 0 and held w = 0; None if none are found.

    ``rows``, (m, n), are directions of possible impulses such as the contacts' normals, and ``held``, (k, n), bilateral
    rows, which may be redundant, both in the metric of the mass matrix; ``speed`` is the largest relative velocity of
    the problem. The impulses p >= 0 have sum 1, rows' p = 0 apart from the held rows and rounding, and p . q < 0.
    """
    length = np.linalg.norm(rows, axis=1)
    length[length == 0.0] = 1.0
    unit, asked = rows / length[:, None], q / length
    if held is not None and held.size:
        unit = _beside(unit, held)
    closing = asked[asked < 0.0]
    if not closing.size or not np.isfinite(unit).all() or not np.isfinite(asked).all():
        return None
    weights = _balanced(unit, asked / -closing.min())
    if weights is None:
        return None
    pressed = weights > 0.0
    work, miss = -(weights @ asked), np.linalg.norm(unit.T @ weights)
    impulses = weights / length
    approach = work / impulses.sum()
    if not (approach > SURE * speed and work > ENDLESS * miss * np.abs(asked[pressed]).max()):
        return None
    return np.asarray(impulses / impulses.sum())


def _balanced(unit: Array, asked: Array) -> Array | None:
    """Return weights >= 0 whose rows cancel while their velocities do not; None if the search does not end."""
    still = ~unit.any(axis=1)  # rows that nothing can move, such as between two fixed bodies
    if (asked[still] < 0.0).any():
        return np.where(still, np.maximum(-asked, 0.0), 0.0)
    target = np.zeros(unit.shape[1] + 1)
    target[-1] = 1.0
    try:
        weights = nonnegative_least_squares(np.vstack([unit.T, -asked]), target)
    except RuntimeError:
        return None
    return weights if weights.any() else None


def _beside(unit: Array, held: Array) -> Array:
    """Return the components of unit rows orthogonal to the held rows."""
    size = np.linalg.norm(held, axis=1)
    _, values, axes = np.linalg.svd(held[size > 0.0] / size[size > 0.0, None], full_matrices=False)
    axes = axes[values > ROUNDING * max(held.shape) * values.max(initial=0.0)]
    for _ in range(2):  # twice, as in Gram-Schmidt: one pass leaves rounding errors
        unit = unit - (unit @ axes.T) @ axes
    left: Array = np.where(np.linalg.norm(unit, axis=1, keepdims=True) > ROUNDING, unit, 0.0)
    return left
