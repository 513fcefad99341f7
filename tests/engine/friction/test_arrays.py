"""A friction problem's memory: arrays apart from each other, at lines of the cache, and ready to be measured."""

import numpy as np
import pytest

from engine.arrays import LINE, aligned_zeros
from engine.friction.arrays import finish, take_contacts
from engine.friction.complementarity import residual
from engine.friction.problem import solver_arrays
from engine.jit import kernel
from tests.engine.friction.problems import natural_map_residual, random_problem


@kernel
def measure(nc, p):
    """Return the residual of the impulses given."""
    scale = take_contacts(nc, p)
    finish(nc, p)
    return residual(p.contacts, scale, 1.0)


def test_arrays_in_one_piece_of_memory():
    """Shapes as asked, also empty ones; each begins at a line, and writing one changes no other."""
    shapes = [(3, 5, 3), 7, 0, (0, 4), (2, 8), 1]
    arrays = aligned_zeros(*shapes)
    assert [a.shape for a in arrays] == [(s,) if isinstance(s, int) else s for s in shapes]
    for number, array in enumerate(arrays, 1):
        assert array.ctypes.data % LINE == 0
        assert array.flags.c_contiguous
        assert not array.any()
        array[...] = number
    for number, array in enumerate(arrays, 1):
        assert (array == number).all()


@pytest.mark.parametrize("contacts", [1, 8, 13])
def test_residual_before_anything_is_solved(contacts):
    """The residual of impulses given to a problem that no solver has seen yet is that of plain NumPy."""
    problem = random_problem(contacts, contacts)
    p, _ = solver_arrays(problem)
    p.q[:], p.mu[:] = problem.q.reshape(contacts, 3), problem.mu
    p.r[:] = np.random.default_rng(0).standard_normal((contacts, 3))
    assert measure(contacts, p) == pytest.approx(natural_map_residual(problem, p.r.ravel()), rel=1e-9)
