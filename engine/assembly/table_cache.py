"""Results that are reused from one assembly to the next while the tables they depend on have not changed.

Between the runs of a campaign few numbers change, and `set_values` creates only the tables that contain them anew; all
others are the same, immutable objects. Dependencies are not listed anywhere: they are recorded while a result is built.
"""

from collections.abc import Callable, Mapping
from functools import wraps
from operator import is_
from types import MethodType
from typing import Any, TypeVar, cast

from engine.mechanism.models import Mechanism

TABLES = frozenset(Mechanism.model_fields)
KEPT = 8  # number of results kept per function, the latest ones
Result = TypeVar("Result")


class TablesRead:
    """A mechanism that records in ``tables`` which of its tables are read, including by its own methods."""

    def __init__(self, mechanism: Mechanism) -> None:
        self._mechanism = mechanism
        self.tables: dict[str, Any] = {}

    def __getattr__(self, name: str) -> Any:
        if name in TABLES:
            return self.tables.setdefault(name, getattr(self._mechanism, name))
        return MethodType(getattr(Mechanism, name), self)


def cached(build: Callable[..., Result]) -> Callable[..., Result]:
    """Let a function return an earlier result if it would build the same one again.

    ``build`` must be a function of a mechanism and of results of other such functions, and of nothing else. An earlier
    result is returned if all tables that were read to build it, and all other arguments, are the same objects. As these
    are immutable, the result is identical to the bit. It must not be modified: runs on other threads use it at the same
    time.
    """
    kept: tuple[tuple[list[tuple[str, Any, Any]], tuple[Any, ...], Result], ...] = ()

    @wraps(build)
    def function(mechanism: Mechanism, *others: Any) -> Result:
        nonlocal kept
        for tables, given, result in kept:
            if all(map(is_, others, given)) and all(
                _identity(getattr(mechanism, name)) == identity for name, _, identity in tables
            ):
                return result
        reading = TablesRead(mechanism)
        result = build(cast(Mechanism, reading), *others)
        # a kept table stays alive, so that no other object can get its id
        tables = [(name, _content(table), _identity(table)) for name, table in reading.tables.items()]
        kept = ((tables, others, result), *kept)[:KEPT]  # a single assignment, whatever other threads do
        return result

    return function


def _content(table: Any) -> Any:
    """Return a table, or the entries of a dict of tables, which somebody may replace."""
    return list(table.values()) if isinstance(table, Mapping) else table


def _identity(table: Any) -> Any:
    """Return a key that only the same table has, or a dict with the same entries."""
    return (list(table), list(map(id, table.values()))) if isinstance(table, Mapping) else id(table)
