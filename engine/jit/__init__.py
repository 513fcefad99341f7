"""All that compiles kernels: the decorators, eight numbers at a time, and what is used of Numba beyond its manual."""

from engine.jit.decorators import CACHE_FOLDER, Callee, Kernel, inner, kernel, not_inlined, uncached
from engine.jit.numba_internals import by_address

__all__ = ["CACHE_FOLDER", "Callee", "Kernel", "by_address", "inner", "kernel", "not_inlined", "uncached"]
