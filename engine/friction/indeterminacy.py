"""How far friction leaves a normal force open: the range over all balanced forces inside Coulomb's cones.

At redundant contacts that stick, the same motion goes with a continuum of forces. For one contact's normal force the
ends of that continuum are two linear programmes: the forces r of all contacts are to give the same generalised impulse
H' r as a known solution, within the cones. Each cone is replaced by ``FACETS`` planes inside it, so that every force
found is one that Coulomb's law allows, and the range is short by at most 1 - cos(pi / FACETS) of a tangential force:
half a percent.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linprog

from engine.friction.problem import FrictionError

Array = NDArray[np.float64]
FACETS = 32
UNBOUNDED = 3  # status of `linprog`
SLACK = 1e-9  # of the largest force: how exactly the known forces lie in their cones


def normal_force_range(H: ArrayLike, mu: ArrayLike, r: ArrayLike, contact: int) -> tuple[float, float]:
    """Return the smallest and the largest normal force of one contact among all forces that balance alike.

    The largest is infinite where friction locks: two opposite walls may be pressed at will.

    Parameters
    ----------
    H : local frames, shape (3 nc, n); rows (N, T1, T2) per contact, in any metric
    mu : coefficients of friction, shape (nc,), >= 0
    r : known forces (or impulses), shape (3 nc,), inside Coulomb's cones
    contact : number of the contact asked for, 0 ... nc - 1

    Raises
    ------
    FrictionError
        If the shapes do not match, there is no such contact, or r does not lie in the cones.
    """
    H, mu, r = np.asarray(H, float), np.asarray(mu, float).ravel(), np.asarray(r, float).ravel()
    nc = mu.size
    if H.ndim != 2 or len(H) != 3 * nc or r.size != 3 * nc:
        raise FrictionError(
            f"indeterminacy: H {H.shape} and r {r.shape} with {nc} contacts; expected (3 nc, n), (3 nc,)"
        )
    if not 0 <= contact < nc:
        raise FrictionError(f"indeterminacy: contact {contact}; allowed: 0 ... {nc - 1}")
    size = float(np.abs(r).max(initial=0))
    if size == 0.0:
        return 0.0, 0.0
    outside = np.hypot(r[1::3], r[2::3]) - mu * r[::3]
    if outside.max() > SLACK**0.5 * size:
        raise FrictionError(f"indeterminacy: r of contact {int(outside.argmax())} is outside Coulomb's cone")

    # unknowns: shares of the generators (1, mu cos a, mu sin a) of each cone, and of the known force itself
    angles = 2 * np.pi * np.arange(FACETS) / FACETS
    generators = np.zeros((3 * nc, nc * (FACETS + 1)))
    for i in range(nc):
        columns = slice(i * (FACETS + 1), (i + 1) * (FACETS + 1) - 1)
        generators[3 * i, columns] = 1.0
        generators[3 * i + 1, columns], generators[3 * i + 2, columns] = mu[i] * np.cos(angles), mu[i] * np.sin(angles)
        generators[3 * i : 3 * i + 3, columns.stop] = r[3 * i : 3 * i + 3] / size
    balance = _independent(H.T @ generators, H.T @ r / size)
    ends = [_extreme(sign * generators[3 * contact], *balance) for sign in (1.0, -1.0)]
    return size * ends[0], -size * ends[1]


def _independent(A: Array, b: Array) -> tuple[Array, Array]:
    """Return the balance in an orthonormal basis of its rows: as many equations as say something."""
    left, values, _ = np.linalg.svd(A, full_matrices=False)
    basis = left[:, values > 1e-10 * values.max(initial=0)]
    return basis.T @ A, basis.T @ b


def _extreme(cost: Array, A: Array, b: Array) -> float:
    found = linprog(cost, A_eq=A, b_eq=b, bounds=(0, None), method="highs-ds", options={"presolve": False})
    if found.status == UNBOUNDED:
        return -np.inf
    if found.status != 0:
        raise FrictionError(f"indeterminacy: the linear programme ended with: {found.message}")
    return float(found.fun)
