"""NumPy's linear algebra in one thread: the last bits of a singular value decomposition depend on their number."""

from contextlib import AbstractContextManager
from functools import cache
from typing import Any

from threadpoolctl import ThreadpoolController


def one_thread() -> AbstractContextManager[Any]:
    """Return a context in which linear algebra gives the same bits on any number of cores."""
    limited: AbstractContextManager[Any] = _threads().limit(limits=1, user_api="blas")
    return limited


@cache
def _threads() -> ThreadpoolController:
    """Return the threads of NumPy's linear algebra; they are looked up once a process."""
    return ThreadpoolController()
