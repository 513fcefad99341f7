"""The public interface of the friction solver: a problem as in the field's collections, and its solution."""

from dataclasses import dataclass
from numbers import Real
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from engine.arrays import Array, Integers
from engine.errors import EngineError
from engine.friction.arrays import CONVERGED, FrictionArrays, friction_arrays
from engine.friction.blocks import BODY
from engine.friction.elimination import eliminate_nodes
from engine.friction.infeasibility import SURE, squeezing_impulses
from engine.friction.solver import solve_friction
from engine.friction.whitening import factorise_mass, place_rows, unwhiten, whiten_rows

ASYMMETRY = 1e-9  # largest asymmetry of M or W, relative to the largest entry


class FrictionError(EngineError):
    """A friction problem is malformed."""


@dataclass(frozen=True, init=False)
class FrictionProblem:
    """Find impulses r in Coulomb's cones with M v = H' r, u = H v + q and u + mu |u_T| N in the dual cones (eq. 5).

    Raises FrictionError if an array does not consist of real numbers, the shapes do not match, a number is not finite,
    a coefficient is negative, or M is not symmetric.
    """

    M: Array  # (n, n) mass matrix, symmetric positive definite
    H: Array  # (3 nc, n) local frames; rows (N, T1, T2) per contact
    q: Array  # (3 nc,) relative velocities without impulses
    mu: Array  # (nc,) coefficients of friction, >= 0

    def __init__(self, M: ArrayLike, H: ArrayLike, q: ArrayLike, mu: ArrayLike) -> None:
        for name, value in {"M": M, "H": H, "q": q, "mu": mu}.items():
            object.__setattr__(self, name, real_numbers(name, value))
        n, nc = len(np.atleast_1d(self.M)), self.mu.size
        for name, shape in {"M": (n, n), "H": (3 * nc, n), "q": (3 * nc,), "mu": (nc,)}.items():
            if getattr(self, name).shape != shape:
                raise FrictionError(f"friction problem: {name} has shape {getattr(self, name).shape}, expected {shape}")
        if (self.mu < 0).any():
            raise FrictionError(f"friction problem: mu[{int(self.mu.argmin())}] = {self.mu.min():g}; allowed: >= 0")
        refuse_asymmetry(self.M, "friction problem: M")


@dataclass(frozen=True)
class FrictionSolution:
    """Solution of a friction problem: "infeasible" if the certificate proves that there is none.

    The certificate, (nc,), holds normal impulses p >= 0 with sum 1 that balance each other, H_N' p = 0, while
    p . q_N < 0. Whatever the bodies do, they approach at the contacts with p > 0 at -p . q_N on average, although the
    law allows no approach. See `engine.friction.infeasibility`.
    """

    r: Array  # (3 nc,) impulses, (N, T1, T2) per contact
    u: Array  # (3 nc,) relative velocities, alike
    v: Array  # (n,) velocities
    residual: float  # relative natural-map residual, see `engine.friction.complementarity.residual`
    iterations: int  # number of solver steps
    status: Literal["converged", "not_converged", "infeasible"]  # converged: residual <= tolerance
    certificate: Array | None = None

    @property
    def converged(self) -> bool:
        """Whether the residual is within the tolerance."""
        return self.status == "converged"


def solve(problem: FrictionProblem, tolerance: float = 1e-8, start: ArrayLike | None = None) -> FrictionSolution:
    """Solve a friction problem to a relative residual, from impulses ``start``, (3 nc,); zero by default.

    Raises FrictionError if the mass matrix is not positive definite, ``start`` has the wrong size, or the tolerance is
    not between 0 and 1.
    """
    nc, n = problem.mu.size, problem.M.shape[0]
    if not isinstance(tolerance, Real) or not 0 < tolerance < 1:
        raise FrictionError(f"friction problem: tolerance = {tolerance!r}; allowed: a number between 0 and 1")
    given = np.zeros(3 * nc) if start is None else real_numbers("start", start)
    if given.size != 3 * nc:
        raise FrictionError(f"friction problem: start has shape {given.shape}, expected {(3 * nc,)}")
    with np.errstate(all="ignore"):  # numbers may come close to the largest double; the residual judges the outcome
        # scale velocities to the order of 1, so that squares are finite; a power of two changes no digit
        unit = float(np.ldexp(0.5, np.frexp(np.abs(problem.q).max(initial=0))[1])) if problem.q.any() else np.inf
        q = problem.q / unit
        arrays, white = solver_arrays(problem)
        arrays.q[:] = q.reshape(nc, 3)
        arrays.mu[:] = problem.mu
        arrays.r[:] = (given / unit).reshape(nc, 3)
        status, iterations, residual = solve_friction(nc, arrays, float(tolerance))
        certificate, speed = None, float(np.abs(q).max(initial=0))
        # A residual relative to the velocities can hide an approach if huge impulses make the bodies fast. If no
        # contact approaches faster than this, no certificate can hold.
        if status != CONVERGED or arrays.u[:, 0].min(initial=0) < -SURE * speed:
            certificate = squeezing_impulses(white.G[::3], q[::3], speed)
        unit = unit if unit < np.inf else 1.0
        v = np.empty(n)
        unwhiten(arrays.w, white.number, white.L, white.first, v)
        return FrictionSolution(
            r=unit * arrays.r.ravel(),
            u=unit * arrays.u.ravel(),
            v=unit * v,
            residual=float(residual),
            iterations=int(iterations),
            status="infeasible" if certificate is not None else "converged" if status == CONVERGED else "not_converged",
            certificate=certificate,
        )


def refuse_asymmetry(A: Array, name: str) -> None:
    """Raise FrictionError with the largest asymmetry of a matrix, if it exceeds rounding errors."""
    size = np.abs(A).max(initial=0)
    off = np.abs(A / 2 - A.T / 2)  # halved, because the difference of two finite numbers may overflow
    if off.max(initial=0) > ASYMMETRY / 2 * size:
        i, j = sorted(map(int, np.unravel_index(off.argmax(), off.shape)))
        raise FrictionError(
            f"{name} is not symmetric: [{i}, {j}] is {A[i, j]:.17g}, [{j}, {i}] is {A[j, i]:.17g};"
            f" allowed: a difference of {ASYMMETRY:g} of the largest entry, {size:.3g}"
        )


def real_numbers(name: str, value: Any) -> Array:
    """Return a contiguous array of finite doubles; raise FrictionError for any other, ragged or masked one."""
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


class Whitening(NamedTuple):
    """The data that relate the arrays of the solver to a problem."""

    L: Array  # (n, n) Cholesky factor of M, see `whitening.factorise_mass`
    first: Integers  # (n,)
    G: Array  # (3 nc, n) whitened rows
    number: Integers  # (nodes,) place of each group of six velocities in the order of elimination


def solver_arrays(problem: FrictionProblem) -> tuple[FrictionArrays, Whitening]:
    """Return the solver's arrays without q and mu; raise FrictionError if M is not positive definite."""
    nc, n = problem.mu.size, problem.M.shape[0]
    nodes = -(-n // BODY)
    L, G, first = np.empty((n, n)), np.empty((3 * nc, n)), np.empty(n, np.int64)
    if not factorise_mass(problem.M, L, first):
        raise FrictionError("friction problem: M is not symmetric positive definite")
    touched, neighbours = np.zeros((nc, nodes), bool), np.zeros((nodes, nodes), bool)
    most = whiten_rows(problem.H, L, first, G, touched, neighbours)
    system, number, piece = eliminate_nodes(neighbours)
    arrays = friction_arrays(system, nc, max(2, most))
    place_rows(G, touched, number, piece, arrays.rows)
    return arrays, Whitening(L, first, G, number)
