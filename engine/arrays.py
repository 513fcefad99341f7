"""The types of the engine's arrays, and copies of many at once."""

from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


LINE = 64  # bytes


def aligned_zeros(*shapes: int | tuple[int, ...]) -> list[Array]:
    """Return arrays of zeros in one piece of memory, each of which begins at a line of the processor's cache."""
    sizes = [-(-8 * (shape if isinstance(shape, int) else prod(shape)) // LINE) * LINE for shape in shapes]
    room = np.zeros(sum(sizes) + LINE, np.uint8)
    at, arrays = -room.ctypes.data % LINE, []
    for shape, size in zip(shapes, sizes, strict=True):
        arrays.append(np.ndarray(shape, np.float64, room, at))
        at += size
    return arrays


def copied(arrays: Any) -> Any:
    """Return a named tuple of arrays, or of such tuples, with copies of all of them.

    Each begins at a line of the processor's cache, so that eight doubles in a row never lie in two.
    """
    room = np.empty(_size(arrays) + LINE, np.uint8)
    return _copy(arrays, room, [-room.ctypes.data % LINE])


def _size(arrays: Any) -> int:
    """Return the bytes that all arrays take, in whole lines."""
    return -(-arrays.nbytes // LINE) * LINE if isinstance(arrays, np.ndarray) else sum(map(_size, arrays))


def _copy(arrays: Any, room: NDArray[np.uint8], at: list[int]) -> Any:
    """Copy arrays into a room, from the place ``at`` on, which moves on."""
    if not isinstance(arrays, np.ndarray):
        return type(arrays)(*(_copy(part, room, at) for part in arrays))
    copy: Any = np.ndarray(arrays.shape, arrays.dtype, room, at[0])
    copy[...] = arrays
    at[0] += _size(arrays)
    return copy
