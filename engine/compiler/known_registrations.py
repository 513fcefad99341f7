"""Numba's table of implementations, filled anew while a kernel compiles only where something was added.

Numba fills it from its registries whenever it looks up an implementation that it does not find, and each array makes it
look up one that arrays do not have: thousands of times, and nearly always nothing is new.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import imputils
from numba.core.base import BaseContext
from numba.core.typing import templates

_refresh = BaseContext.refresh


@contextmanager
def registrations_known() -> Iterator[None]:
    """Skip what is in vain while the block runs, which holds Numba's lock; one within another has no effect."""
    if BaseContext.refresh is not _refresh:
        yield
        return
    filled: dict[int, tuple[int, ...]] = {}  # by the identity of the context, which outlives the block

    def refresh(self: Any) -> None:
        if filled.get(id(self)) != _registered():
            _refresh(self)  # type: ignore[no-untyped-call]
            filled[id(self)] = _registered()

    BaseContext.refresh = refresh  # type: ignore[method-assign]
    try:
        yield
    finally:
        BaseContext.refresh = _refresh  # type: ignore[method-assign]


def _registered() -> tuple[int, ...]:
    """Return how many items each list of Numba's registries has; nothing is ever taken out."""
    code, typing = imputils.builtin_registry, templates.builtin_registry
    of_code = code.functions, code.getattrs, code.setattrs, code.casts, code.constants
    return tuple(map(len, (*of_code, typing.functions, typing.attributes, typing.globals)))
