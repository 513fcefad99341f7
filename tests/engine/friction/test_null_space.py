"""An orthonormal basis of a null space, against its definition and LAPACK's rank."""

import numpy as np
import pytest

from engine.friction.null_space import null_space
from tests.each import each

pytestmark = pytest.mark.bits


def matrix(seed: int, size: float) -> np.ndarray:
    """Return up to 50 rows of up to 60 numbers, of any rank, some of them zero, or the same as others."""
    rng = np.random.default_rng(seed)
    m, n = int(rng.integers(0, 50)), int(rng.integers(1, 60))
    rank = int(rng.integers(0, min(m, n) + 1))
    rows = rng.normal(size=(m, rank)) @ rng.normal(size=(rank, n))
    rows[rng.random(m) < 0.2] = 0.0
    rows[:, rng.random(n) < 0.1] = 0.0
    return size * rows


@each("size", [1e-30, 1.0, 1e30])
@each("seed", range(40))
def test_a_basis_of_the_null_space(seed, size):
    """It is orthonormal, the rows vanish on it, and its dimension is what the rank leaves."""
    rows = matrix(seed, size)
    kept = rows.copy()
    basis = null_space(rows)
    np.testing.assert_array_equal(rows, kept)
    n = rows.shape[1]
    assert basis.shape == (n, n - (np.linalg.matrix_rank(rows, tol=1e-9 * np.abs(rows).max()) if rows.any() else 0))
    np.testing.assert_allclose(basis.T @ basis, np.eye(basis.shape[1]), atol=1e-13)
    np.testing.assert_allclose(rows @ basis, 0.0, atol=1e-12 * max(np.abs(rows).max(initial=0.0), 1e-300))
    assert null_space(rows).tobytes() == basis.tobytes()


def test_rows_that_are_nearly_the_same():
    """A difference of 1e-6 is a direction of its own, one of 1e-13 is rounding."""
    rows = np.array([[1.0, 2.0, 3.0], [1.0, 2.0, 3.0 + 1e-6], [1.0, 2.0 + 1e-13, 3.0]])
    assert null_space(rows).shape == (3, 1)
    np.testing.assert_allclose(np.abs(null_space(rows)[:, 0]), [2 / 5**0.5, 1 / 5**0.5, 0.0], atol=1e-6)
