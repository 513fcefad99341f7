"""Sizes of LLVM's types, remembered while a kernel compiles.

Numba asks for the size of each variable and of each array's items, thousands of times in all, and each time LLVM reads
a module of text with one variable of the type in it. The kernels have some dozens of types.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from numba.core.base import BaseContext

_size_of = BaseContext.get_abi_sizeof


@contextmanager
def sizes_remembered() -> Iterator[None]:
    """Remember sizes while the block runs, which holds Numba's lock; one within another has no effect."""
    if BaseContext.get_abi_sizeof is not _size_of:
        yield
        return
    sizes: dict[tuple[int, str], int] = {}  # by the identity of the context, which outlives the block, and the type

    def get_abi_sizeof(self: Any, ty: Any) -> int:
        key = id(self), str(ty)
        if key not in sizes:
            sizes[key] = _size_of(self, ty)  # type: ignore[no-untyped-call]
        return sizes[key]

    BaseContext.get_abi_sizeof = get_abi_sizeof  # type: ignore[method-assign]
    try:
        yield
    finally:
        BaseContext.get_abi_sizeof = _size_of  # type: ignore[method-assign]
