"""Rows that repeat others, exactly or nearly, are marked; the others are independent."""

import numpy as np
import pytest

from engine.friction.redundancy import mark_redundant
from tests.each import each
from tests.engine.friction.chains import dense_bilateral, tied_bodies

pytestmark = pytest.mark.bits

SHARE = 1e-4


def marked(p, redundant):
    """Return the marks after another decision."""
    mark_redundant(p.system, p.bilateral, SHARE, redundant)
    return redundant.copy()


@each("off", [0.0, 1e-9, 1e-6, 1e-5])
@each("seed", range(3))
def test_rows_that_nearly_repeat_others(off, seed):
    """One row of each joint follows from another but for a small share: one of each joint is left out, as before."""
    p, n = tied_bodies(seed, 8, tree=True, redundant=True)
    rows = p.bilateral.J.reshape(8, 6, 16)
    rows[:, -1, :6] += off * np.random.default_rng(seed).standard_normal((8, 6))
    redundant = np.zeros(48, bool)
    first = marked(p, redundant)
    assert (first.reshape(8, 6).sum(axis=1) == 1).all()
    kept = dense_bilateral(p, n)[~first]
    kept /= np.linalg.norm(kept, axis=1, keepdims=True)
    assert np.linalg.svd(kept, compute_uv=False).min() > 10 * SHARE
    np.testing.assert_array_equal(marked(p, redundant), first)


def test_rows_that_differ_enough_and_rows_of_zeros():
    """Neither is marked."""
    p, _ = tied_bodies(0, 6, redundant=True)
    p.bilateral.J.reshape(6, 6, 16)[:, -1, :6] += 0.1
    p.bilateral.J[7] = 0.0
    assert not marked(p, np.zeros(36, bool)).any()
