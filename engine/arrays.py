"""The array types of the engine, and aligned allocation and copying of many arrays at once."""

from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
LINE = 64  # bytes


def aligned_zeros(*shapes: int | tuple[int, ...]) -> list[Array]:
    """Return arrays of zeros in one block of memory, each starting at a cache line of the processor."""
    sizes = [-(-8 * (shape if isinstance(shape, int) else prod(shape)) // LINE) * LINE for shape in shapes]
    room = np.zeros(sum(sizes) + LINE, np.uint8)
    at, arrays = -room.ctypes.data % LINE, []
    for shape, size in zip(shapes, sizes, strict=True):
        arrays.append(np.ndarray(shape, np.float64, room, at))
        at += size
    return arrays


class Block:
    """Copies of all arrays of nested named tuples in one block, each from a cache line: no eight doubles span two."""

    def __init__(self, arrays: Any) -> None:
        room = np.empty(_size(arrays) + LINE, np.uint8)
        start = -room.ctypes.data % LINE
        self._memory = room[start : start + len(room) - LINE]
        self.arrays = _copy(arrays, self._memory, [0])
        self._twin: Block | None = None

    def assign(self, other: "Block") -> None:
        """Overwrite all numbers with those of another block of the same arrays."""
        self._memory[:] = other._memory

    def twin(self) -> "Block":
        """Return a copy of this block. It is made once, and each call writes the present numbers into it."""
        if self._twin is None:
            self._twin = Block(self.arrays)
        else:
            self._twin.assign(self)
        return self._twin


def copied(arrays: Any) -> Any:
    """Return a copy of a named tuple of arrays, or of nested named tuples, as a `Block` of its own."""
    return Block(arrays).arrays


def _size(arrays: Any) -> int:
    """Return the size of all arrays in bytes, each rounded up to whole cache lines."""
    return -(-arrays.nbytes // LINE) * LINE if isinstance(arrays, np.ndarray) else sum(map(_size, arrays or ()))


def _copy(arrays: Any, room: NDArray[np.uint8], at: list[int]) -> Any:
    """Copy arrays into the buffer ``room`` from offset ``at[0]`` on; the offset is advanced."""
    if arrays is None:
        return None
    if not isinstance(arrays, np.ndarray):
        return arrays._make([_copy(part, room, at) for part in arrays])
    copy: Any = np.ndarray(arrays.shape, arrays.dtype, room, at[0])
    copy[...] = arrays
    at[0] += -(-arrays.nbytes // LINE) * LINE
    return copy
