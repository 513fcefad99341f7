"""The public face of the friction solver: a problem in the form of the field's collections, and its solution."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from engine.arrays import Array
from engine.errors import EngineError
from engine.friction.arrays import CONVERGED, FrictionArrays, friction_arrays
from engine.friction.banded import BODY, PAIR
from engine.friction.solver import solve_friction


class FrictionError(EngineError):
    """A friction problem is malformed."""


@dataclass(frozen=True, init=False)
class FrictionProblem:
    """Find impulses r in Coulomb's cones with M v = H' r, u = H v + q and u + mu |u_T| N in the dual cones (eq. 5).

    Attributes
    ----------
    M : (n, n) array
        Mass matrix, symmetric positive definite.
    H : (3 nc, n) array
        Local frames; rows (N, T1, T2) per contact.
    q : (3 nc,) array
        Relative velocities without impulses.
    mu : (nc,) array
        Coefficients of friction, >= 0.

    Raises
    ------
    FrictionError
        If the shapes do not fit together, a number is not finite, or a coefficient is negative.
    """

    M: Array
    H: Array
    q: Array
    mu: Array

    def __init__(self, M: ArrayLike, H: ArrayLike, q: ArrayLike, mu: ArrayLike) -> None:
        arrays = {"M": M, "H": H, "q": q, "mu": mu}
        for name, value in arrays.items():
            object.__setattr__(self, name, np.ascontiguousarray(value, dtype=float))
        n, nc = self.M.shape[0], self.mu.size
        for name, shape in {"M": (n, n), "H": (3 * nc, n), "q": (3 * nc,), "mu": (nc,)}.items():
            if getattr(self, name).shape != shape:
                raise FrictionError(f"friction problem: {name} has shape {getattr(self, name).shape}, expected {shape}")
            if not np.isfinite(getattr(self, name)).all():
                raise FrictionError(f"friction problem: {name} holds a number that is not finite")
        if (self.mu < 0).any():
            raise FrictionError(f"friction problem: mu[{int(self.mu.argmin())}] = {self.mu.min():g}; allowed: >= 0")


@dataclass(frozen=True)
class FrictionSolution:
    """Solution of a friction problem.

    Attributes
    ----------
    r, u : (3 nc,) arrays
        Impulses and relative velocities, (N, T1, T2) per contact.
    v : (n,) array
        Velocities.
    residual : float
        Relative natural-map residual, see `engine.friction.cone.residual`.
    iterations : int
        Steps of the solver.
    converged : bool
        Whether ``residual <= tolerance``.
    """

    r: Array
    u: Array
    v: Array
    residual: float
    iterations: int
    converged: bool


def solve(problem: FrictionProblem, tolerance: float = 1e-8, start: ArrayLike | None = None) -> FrictionSolution:
    """Solve a friction problem.

    Parameters
    ----------
    problem : FrictionProblem
    tolerance : float
        Relative residual to reach; it does not depend on units.
    start : (3 nc,) array, optional
        Impulses to start from; zero by default.

    Returns
    -------
    FrictionSolution

    Raises
    ------
    FrictionError
        If the mass matrix is not positive definite.
    """
    nc, n = problem.mu.size, problem.M.shape[0]
    try:
        root = np.linalg.cholesky(problem.M)
    except np.linalg.LinAlgError:
        raise FrictionError("friction problem: M is not symmetric positive definite") from None
    G = np.linalg.solve(root, problem.H.T).T.reshape(nc, 3, n)
    arrays = sparse_rows(G, n)
    arrays.q[:] = problem.q.reshape(nc, 3)
    arrays.mu[:] = problem.mu
    if start is not None:
        arrays.r[:] = np.asarray(start, float).reshape(nc, 3)
    status, iterations, residual = solve_friction(n, nc, arrays, tolerance)
    return FrictionSolution(
        r=arrays.r.ravel(),
        u=arrays.u.ravel(),
        v=np.linalg.solve(root.T, arrays.w),
        residual=float(residual),
        iterations=int(iterations),
        converged=status == CONVERGED,
    )


def sparse_rows(G: Array, n: int) -> FrictionArrays:
    """Store each contact's rows of G, shape (nc, 3, n), without the columns of zeros, body by body."""
    nc, bodies = len(G), -(-n // BODY)
    touched = np.zeros((nc, bodies * BODY), bool)
    touched[:, :n] = np.abs(G).max(axis=1) > 0
    blocks = touched.reshape(nc, bodies, BODY)
    contact, body = np.nonzero(blocks.any(axis=2))  # contact by contact
    start = BODY * body + blocks.argmax(axis=2)[contact, body]
    width = BODY * (body + 1) - blocks[:, :, ::-1].argmax(axis=2)[contact, body] - start
    runs = np.bincount(contact, minlength=nc)
    columns = np.bincount(contact, width, minlength=nc)
    spans = [np.flatnonzero(row) for row in touched if row.any()]
    arrays = friction_arrays(
        n,
        nc,
        max(2, int(runs.max(initial=0))),
        max(PAIR, int(columns.max(initial=0))),
        max((int(span[-1] - span[0]) for span in spans), default=0),
    )
    run, filled = [0] * nc, [0] * nc
    for i, first, count in zip(contact.tolist(), start.tolist(), width.tolist(), strict=True):
        arrays.rows.G[i, :, filled[i] : filled[i] + count] = G[i, :, first : first + count]
        arrays.rows.start[i, run[i]], arrays.rows.width[i, run[i]] = first, count
        run[i] += 1
        filled[i] += count
    return arrays
