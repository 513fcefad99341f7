"""The public face of the friction solver: a problem in the form of the field's collections, and its solution."""

from dataclasses import dataclass
from numbers import Real
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from engine.arrays import Array, Integers
from engine.errors import EngineError
from engine.friction.arrays import CONVERGED, FrictionArrays, friction_arrays
from engine.friction.banded import BODY, PAIR
from engine.friction.infeasibility import squeezing_impulses
from engine.friction.solver import solve_friction

ASYMMETRY = 1e-9  # largest of M, relative to its largest entry


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
        If an array is not one of real numbers, the shapes do not fit together, a number is not finite, a coefficient is
        negative, or M is not symmetric.
    """

    M: Array
    H: Array
    q: Array
    mu: Array

    def __init__(self, M: ArrayLike, H: ArrayLike, q: ArrayLike, mu: ArrayLike) -> None:
        for name, value in {"M": M, "H": H, "q": q, "mu": mu}.items():
            object.__setattr__(self, name, real_numbers(name, value))
        n, nc = len(np.atleast_1d(self.M)), self.mu.size
        for name, shape in {"M": (n, n), "H": (3 * nc, n), "q": (3 * nc,), "mu": (nc,)}.items():
            if getattr(self, name).shape != shape:
                raise FrictionError(f"friction problem: {name} has shape {getattr(self, name).shape}, expected {shape}")
        if (self.mu < 0).any():
            raise FrictionError(f"friction problem: mu[{int(self.mu.argmin())}] = {self.mu.min():g}; allowed: >= 0")
        # halves, as a difference of two finite numbers may be infinite
        if np.abs(self.M / 2 - self.M.T / 2).max(initial=0) > ASYMMETRY * np.abs(self.M).max(initial=0):
            raise FrictionError("friction problem: M is not symmetric positive definite")


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
    status : str
        "converged" if ``residual <= tolerance``; "infeasible" if the certificate proves that there is no solution;
        else "not_converged".
    certificate : (nc,) array or None
        Of an infeasible problem: normal impulses p >= 0 of sum 1 that balance each other, H_N' p = 0, while
        p . q_N < 0. Whatever the bodies do, their approach at the contacts with p > 0 is -p . q_N on average, and the
        law asks for none. See `engine.friction.infeasibility`.
    """

    r: Array
    u: Array
    v: Array
    residual: float
    iterations: int
    status: Literal["converged", "not_converged", "infeasible"]
    certificate: Array | None = None

    @property
    def converged(self) -> bool:
        """Whether the residual is within the tolerance."""
        return self.status == "converged"


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
        If the mass matrix is not positive definite, ``start`` does not fit, or the tolerance is not between 0 and 1.
    """
    nc, n = problem.mu.size, problem.M.shape[0]
    if not isinstance(tolerance, Real) or not 0 < tolerance < 1:
        raise FrictionError(f"friction problem: tolerance = {tolerance!r}; allowed: a number between 0 and 1")
    given = np.zeros(3 * nc) if start is None else real_numbers("start", start)
    if given.size != 3 * nc:
        raise FrictionError(f"friction problem: start has shape {given.shape}, expected {(3 * nc,)}")
    try:
        root = np.linalg.cholesky(problem.M)
    except np.linalg.LinAlgError:
        raise FrictionError("friction problem: M is not symmetric positive definite") from None
    with np.errstate(all="ignore"):  # numbers near the largest double: the residual judges what becomes of them
        # velocities of the order of 1, whose squares are numbers; a power of two changes no digit
        unit = float(np.ldexp(0.5, np.frexp(np.abs(problem.q).max(initial=0))[1])) if problem.q.any() else np.inf
        q = problem.q / unit
        G = np.linalg.solve(root, problem.H.T).T.reshape(nc, 3, n)
        arrays = sparse_rows(G, n)
        arrays.q[:] = q.reshape(nc, 3)
        arrays.mu[:] = problem.mu
        arrays.r[:] = (given / unit).reshape(nc, 3)
        status, iterations, residual = solve_friction(n, nc, arrays, float(tolerance))
        certificate = None
        if status != CONVERGED:
            certificate = squeezing_impulses(G[:, 0], q[::3], float(np.abs(q).max()))
        unit = unit if unit < np.inf else 1.0
        return FrictionSolution(
            r=unit * arrays.r.ravel(),
            u=unit * arrays.u.ravel(),
            v=unit * np.linalg.solve(root.T, arrays.w),
            residual=float(residual),
            iterations=int(iterations),
            status="converged" if status == CONVERGED else "not_converged" if certificate is None else "infeasible",
            certificate=certificate,
        )


def real_numbers(name: str, value: Any) -> Array:
    """Return a contiguous array of finite doubles.

    Raises
    ------
    FrictionError
        If it holds something else, is ragged or masked, or a number is not finite.
    """
    try:
        with np.errstate(all="ignore"):
            given = np.asanyarray(value)
            masked = isinstance(given, np.ma.MaskedArray)
            numbers = None if masked or given.dtype.kind not in "biuf" else np.ascontiguousarray(given, dtype=float)
    except (TypeError, ValueError, OverflowError):
        numbers = None
    if numbers is None:
        raise FrictionError(f"friction problem: {name} is not an array of real numbers")
    if not np.isfinite(numbers).all():
        raise FrictionError(f"friction problem: {name} holds a number that is not finite")
    return numbers


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


def dense_rows(start: Integers, width: Integers, rows: Array, n: int) -> Array:
    """Return rows that are stored run by run, shape (m, j, k), as dense rows of ``n`` columns, shape (m, j, n)."""
    dense = np.zeros((*rows.shape[:2], n))
    for i in range(len(rows)):
        filled = 0
        for first, count in zip(start[i], width[i], strict=True):
            dense[i, :, first : first + count] += rows[i, :, filled : filled + count]
            filled += count
    return dense
