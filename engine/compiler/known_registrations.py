"""Refill Numba's table of implementations during compilation only if something was added.

Numba refills it from its registries whenever a lookup finds no implementation, and each array causes a lookup of one
that arrays do not have: thousands of times, and nearly always nothing is new.
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
    """Skip useless refreshes inside the block, which holds Numba's lock; nested blocks have no effect."""
    if BaseContext.refresh is not _refresh:
        yield
        return
    lists: dict[int, list[list[Any]]] = {}  # by the id of the context, which outlives the block
    filled: dict[int, int] = {}

    def refresh(self: Any) -> None:
        if id(self) not in filled or sum(map(len, lists[id(self)])) != filled[id(self)]:
            _refresh(self)  # type: ignore[no-untyped-call]
            lists[id(self)] = _registrations(self)
            filled[id(self)] = sum(map(len, lists[id(self)]))

    BaseContext.refresh = refresh  # type: ignore[method-assign]
    try:
        yield
    finally:
        BaseContext.refresh = _refresh  # type: ignore[method-assign]


def _registrations(context: Any) -> list[list[Any]]:
    """Return the lists that a context has been filled from; each of them only grows.

    Numba registers its own intrinsics not in the built-in registry but in the first one that the context knows.
    """
    of_code, of_types = imputils.RegistryLoader.registry_items, templates.RegistryLoader.registry_items
    lists = [getattr(registry, items) for registry in context._registries for items in of_code]
    return lists + [getattr(registry, items) for registry in context.typing_context._registries for items in of_types]
