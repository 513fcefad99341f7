"""Cholesky's factor of a mass matrix from the first entry of each row on, and the whitened rows, against NumPy's."""

import numpy as np
import pytest

from engine.friction.arrays import dense_rows
from engine.friction.blocks import ROW
from engine.friction.problem import FrictionProblem, solver_arrays
from engine.friction.whitening import factorise_mass, unwhiten
from tests.each import each
from tests.engine.friction.problems import random_problem

pytestmark = pytest.mark.bits


def mass_matrix(kind, n, rng):
    """Return a mass matrix that is dense, of blocks of bodies, or with some zeros anywhere."""
    root = rng.standard_normal((n, n))
    M = root @ root.T + 0.1 * np.eye(n)
    if kind == "blocks":
        return M * np.kron(np.eye(-(-n // 6)), np.ones((6, 6)))[:n, :n]
    if kind == "some zeros":
        M[: n // 2, n // 2] = M[n // 2, : n // 2] = 0.0
        M += n * np.eye(n)
    return M


@each("kind", ["dense", "blocks", "some zeros"])
@each("n", [1, 6, 7, 20])
def test_the_factor_is_cholesky_s(kind, n):
    """L L' = M, whatever of M is zero; the diagonal is inverted."""
    M = mass_matrix(kind, n, np.random.default_rng(n))
    L, first = np.full((n, n), np.nan), np.empty(n, np.int64)
    assert factorise_mass(M, L, first)
    dense = np.where(np.arange(n) >= first[:, None], np.tril(np.nan_to_num(L)), 0.0)
    np.fill_diagonal(dense, 1 / np.diag(L))
    np.testing.assert_allclose(dense, np.linalg.cholesky(M), atol=1e-12 * np.abs(M).max())


def test_what_has_no_factor_is_refused():
    """A negative direction, and one of no mass."""
    for M in (np.diag([1.0, -1.0]), np.ones((2, 2)), np.zeros((1, 1))):
        assert not factorise_mass(M, np.empty(M.shape), np.empty(len(M), np.int64))


@pytest.mark.parametrize("kind", ["dense", "blocks"])
def test_rows_and_velocities_are_whitened(kind):
    """G = H L^-T node by node; velocities come back as L^-T w."""
    rng = np.random.default_rng(3)
    once = random_problem(1, 9, bodies=4)
    problem = FrictionProblem(mass_matrix(kind, 24, rng), once.H, once.q, once.mu)
    arrays, white = solver_arrays(problem)
    place = (ROW * white.number[:, None] + np.arange(6)).ravel()
    root = np.linalg.cholesky(problem.M)
    expected = np.linalg.solve(root, problem.H.T).T
    np.testing.assert_allclose(white.G, expected, atol=1e-12)
    dense = dense_rows(arrays.rows.node, arrays.rows.G, arrays.w.size)
    np.testing.assert_allclose(dense[:, :, place].reshape(27, 24), expected, atol=1e-12)
    w, v = np.zeros(arrays.w.size), np.empty(24)
    w[place] = rng.standard_normal(24)
    unwhiten(w, white.number, white.L, white.first, v)
    np.testing.assert_allclose(v, np.linalg.solve(root.T, w[place]), atol=1e-12)
