"""A proof that a friction problem has no solution: impulses that balance each other and yet work against the motion.

Coulomb's law asks for a velocity with u_N >= 0 at every contact. By Farkas' lemma there is none if and only if there
are weights p >= 0, not all zero, with H_N' p = 0 (but for what bilateral rows hold) and p . q_N < 0: the contacts with
p > 0 squeeze what lies between them. Whatever the bodies do, their mean approach, weighted with p, stays. The weights
are found as Lawson and Hanson solve a least-distance problem (Solving Least Squares Problems, chapter 23): the p >= 0
that minimises |H_N' p|^2 + (1 + q_N . p)^2 balances if no velocity fits; else it leads to the least velocity.
"""

import numpy as np

from engine.arrays import Array

# Of rounded numbers no balance is exact. With a miss e = H_N' p it still proves that a velocity that fits is at least
# p . (-q_N) / |e|. Below so many times the velocity that each contact alone asks for, there may be a solution.
ENDLESS = 3e9
SURE = 1e-9  # share of the largest relative velocity: a slower mean approach may be what rounding left of none
ROUNDING = 1e-12  # share of a row: less than this beside the bilateral rows is what rounding left of nothing


def squeezing_impulses(rows: Array, q: Array, speed: float, held: Array | None = None) -> Array | None:
    """Return impulses that prove that no velocity w satisfies rows w + q >= 0 and held w = 0; None if none do.

    Parameters
    ----------
    rows : (m, n) array
        Directions of possible impulses, such as the contacts' normals, in the metric of the mass matrix.
    q : (m,) array
        Relative velocities along them without impulses.
    speed : float
        Largest relative velocity of the problem.
    held : (k, n) array, optional
        Bilateral rows, in the same metric; they may be redundant.

    Returns
    -------
    (m,) array or None
        Impulses >= 0 of sum 1, with ``rows.T @ p`` = 0 but for the held rows and rounding, and ``p @ q`` < 0.
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
    """Return weights >= 0 whose rows cancel, and whose velocities do not; None if the search does not end."""
    from scipy.optimize import nnls

    still = ~unit.any(axis=1)  # nothing can move these, as between two fixed bodies
    if (asked[still] < 0.0).any():
        return np.where(still, np.maximum(-asked, 0.0), 0.0)
    target = np.zeros(unit.shape[1] + 1)
    target[-1] = 1.0
    try:
        weights, _ = nnls(np.vstack([unit.T, -asked]), target)
    except RuntimeError:
        return None
    return weights if weights.any() else None


def _beside(unit: Array, held: Array) -> Array:
    """Return what is left of rows of length 1 without the directions of the held rows."""
    size = np.linalg.norm(held, axis=1)
    _, values, axes = np.linalg.svd(held[size > 0.0] / size[size > 0.0, None], full_matrices=False)
    axes = axes[values > ROUNDING * max(held.shape) * values.max(initial=0.0)]
    for _ in range(2):  # as Gram and Schmidt, twice: once leaves rounding
        unit = unit - (unit @ axes.T) @ axes
    left: Array = np.where(np.linalg.norm(unit, axis=1, keepdims=True) > ROUNDING, unit, 0.0)
    return left
