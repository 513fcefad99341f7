"""Remember the sizes of LLVM's types while a kernel compiles.

Numba asks for the size of each variable and of each array's items, thousands of times in all, and each time LLVM parses
a module with one variable of this type. The kernels use a few dozen types.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from numba.core.base import BaseContext

_size_of = BaseContext.get_abi_sizeof


@contextmanager
def sizes_remembered() -> Iterator[None]:
    """Remember sizes inside the block, which holds Numba's lock; nested blocks have no effect."""
    if BaseContext.get_abi_sizeof is not _size_of:
        yield
        return
    sizes: dict[tuple[int, str], int] = {}  # by the type and the id of the context, which outlives the block

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
