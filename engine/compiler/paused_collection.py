"""Pause Python's garbage collection while a kernel compiles.

Numba creates millions of small objects, nearly all of which live until the kernel is compiled. The garbage collector
examined them again and again and found hardly any to free, which took a seventh of the compilation time.
"""

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def collection_paused() -> Iterator[None]:
    """Pause garbage collection inside the block, which holds Numba's lock; if it was off, it stays off."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()
