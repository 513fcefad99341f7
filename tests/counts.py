"""How many items a loop of the quick suite takes."""

import os
from collections.abc import Iterable
from typing import TypeVar

T = TypeVar("T")


def many(count: int) -> int:
    """Return the number of items of a loop: all where new seeds are drawn (`make full`), a quarter in `make test`."""
    return count if os.environ.get("CLEARCAP_FRESH") else max(count // 4, 1)


def some(items: Iterable[T]) -> list[T]:
    """Return all items where new seeds are drawn, every fourth of them in `make test`."""
    return list(items)[:: 1 if os.environ.get("CLEARCAP_FRESH") else 4]
