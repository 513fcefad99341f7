"""Named tuples that kernels hand on by address: every kind of field arrives, and nothing is copied."""

from typing import NamedTuple

import numpy as np
import pytest
from numba.core.errors import TypingError

from engine.jit import inner, kernel
from engine.jit.numba_internals import TupleByAddress, by_address


@by_address
class Grid(NamedTuple):
    """Arrays of several kinds."""

    flags: np.ndarray  # (n,) bool
    numbers: np.ndarray  # (n, 2) int64
    heights: np.ndarray  # (2, 3, n) any layout


@by_address
class Terrain(NamedTuple):
    """Numbers around a tuple."""

    scale: float
    count: int
    shown: bool
    grid: Grid
    name: np.ndarray  # (n,)


@kernel
def describe(terrain, out):
    """Write what is seen of a tuple and of the tuple in it."""
    out[0], out[1], out[2] = terrain.scale, terrain.count, terrain.shown
    out[3] = total_height(terrain.grid)
    out[4] = terrain.grid.numbers[1, 1]
    for flag in terrain.grid.flags:
        out[5] += flag
    heights = terrain.grid.heights
    out[6], out[7], out[8] = heights.size, heights.strides[1], heights[1].sum()
    terrain.name[0] += 1.0


@inner
def total_height(grid):
    """Return the sum of an array of three axes."""
    total = 0.0
    for i in range(grid.heights.shape[0]):
        for j in range(grid.heights.shape[1]):
            for k in range(grid.heights.shape[2]):
                total += grid.heights[i, j, k]
    return total


def terrain(heights, **changes):
    """Return a tuple around given heights."""
    grid = Grid(np.array([True, False, True]), np.arange(6).reshape(3, 2), heights)
    return Terrain(**{"scale": 0.5, "count": -7, "shown": True, "grid": grid, "name": np.zeros(2), **changes})


LAYOUTS = {
    "C": lambda a: a,
    "Fortran": np.asfortranarray,
    "strided": lambda a: np.repeat(a, 2, axis=2)[:, :, ::2],
    "backwards": lambda a: a[:, ::-1].copy()[:, ::-1],
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_all_fields_arrive(layout):
    """Numbers, truth values, tuples in tuples, and arrays of every layout with shape and strides."""
    heights = LAYOUTS[layout](np.random.default_rng(5).integers(0, 99, (2, 3, 4)).astype(float))
    given, out = terrain(heights), np.zeros(9)
    describe(given, out)
    assert out.tolist() == [0.5, -7, 1, heights.sum(), 3, 2, 24, heights.strides[1], heights[1].sum()]
    assert given.name.tolist() == [1.0, 0.0]


def test_each_call_reads_its_own_tuple():
    """What Python hands over at a call is read at that call."""
    for count in (1, 2, 3):
        given, out = terrain(np.full((2, 3, count), float(count)), count=count, shown=count == 2), np.zeros(9)
        describe(given, out)
        assert out[:5].tolist() == [0.5, count, count == 2, 6.0 * count**2, 3]


def test_one_address_a_tuple():
    """A kernel takes one address for a tuple, whatever is in it: only so are calls between kernels short."""
    out = np.zeros(9)
    describe(terrain(np.zeros((2, 3, 4))), out)
    describe(terrain(np.asfortranarray(np.zeros((2, 3, 4)))), out)
    types = [signature[0] for signature in describe.compiled.signatures]
    assert all(isinstance(kind, TupleByAddress) for kind in types)
    assert len(types) == len(set(types)) >= 2  # layouts differ
    assert all(len(kind.name) < 30 for kind in types)  # it is in the name of every kernel


def test_a_field_that_is_not_there():
    """It is an error of compilation, which names the tuple."""

    @kernel
    def wrong(given):
        return given.depth

    with pytest.raises(TypingError, match="depth"):
        wrong(terrain(np.zeros((2, 3, 4))))
