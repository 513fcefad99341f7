"""NumPy's linear algebra in one thread: the last bits of a singular value decomposition depend on the threads."""

from contextlib import AbstractContextManager
from functools import cache
from typing import Any

from threadpoolctl import ThreadpoolController


def one_thread() -> AbstractContextManager[Any]:
    """Return a context in which linear algebra gives the same bits whatever the number of cores."""
    limited: AbstractContextManager[Any] = _threads().limit(limits=1, user_api="blas")
    return limited


@cache
def _threads() -> ThreadpoolController:
    """Return the controller of the threads of NumPy's linear algebra; it is created once per process."""
    return ThreadpoolController()
