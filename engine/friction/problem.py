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
    M : mass matrix, shape (n, n), symmetric positive definite
    H : local frames, shape (3 nc, n); rows (N, T1, T2) per contact
    q : relative velocities without impulses, shape (3 nc,)
    mu : coefficients of friction, shape (nc,), >= 0
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
    r, u : impulses and relative velocities, shape (3 nc,), (N, T1, T2) per contact
    v : velocities, shape (n,)
    residual : relative natural-map residual, see `engine.friction.cone.residual`
    iterations : Newton steps
    converged : ``residual <= tolerance``
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
    problem : the problem
    tolerance : relative residual to reach; it does not depend on units
    start : impulses to start from, shape (3 nc,); zero by default

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
    """Store of each contact's rows only the columns that are not zero, body by body."""
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
