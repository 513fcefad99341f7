"""Python's search for circles of objects that nobody needs, paused while a kernel compiles.

Numba makes millions of small objects, of which nearly all live until the kernel is compiled: Python looked through them
again and again and found hardly any to free. That was a seventh of the time of compiling.
"""

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def collection_paused() -> Iterator[None]:
    """Pause the search while the block runs, which holds Numba's lock; where it is off, it stays off."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()
