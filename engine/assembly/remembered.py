"""Results that are kept from one assembly to the next, for as long as nothing that they follow from has changed.

Between the runs of a campaign few numbers change, and `set_values` makes only the tables on the way to them anew; all
others are the same objects, and immutable. What a result follows from is not listed anywhere: it is noted while the
result is built.
"""

from collections.abc import Callable, Mapping
from functools import wraps
from types import MethodType
from typing import Any, TypeVar, cast

from engine.mechanism.models import Mechanism

TABLES = frozenset(Mechanism.model_fields)
KEPT = 8  # results of each function, the latest ones
Result = TypeVar("Result")


class TablesRead:
    """A mechanism that notes which of its tables are read, also by its own methods.

    Attributes
    ----------
    tables : dict
        Name -> table, of those that have been read.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self._mechanism = mechanism
        self.tables: dict[str, Any] = {}

    def __getattr__(self, name: str) -> Any:
        if name in TABLES:
            return self.tables.setdefault(name, getattr(self._mechanism, name))
        return MethodType(getattr(Mechanism, name), self)


def remembered(build: Callable[..., Result]) -> Callable[..., Result]:
    """Let a function return an earlier result where it would build the same one again.

    Parameters
    ----------
    build : callable
        A function of a mechanism and, after it, of results of other such functions, and of nothing else. Nobody may
        change what it returns: runs on other threads use it at the same time.

    Returns
    -------
    callable
        The function. An earlier result is returned if all tables that were read when it was built, and all other
        arguments, are the same objects; as they are immutable, it is the same to the bit.
    """
    kept: tuple[tuple[list[tuple[str, Any, Any]], tuple[Any, ...], Result], ...] = ()

    @wraps(build)
    def function(mechanism: Mechanism, *others: Any) -> Result:
        nonlocal kept
        for tables, given, result in kept:
            if all(map(_same, others, given)) and all(
                _identity(getattr(mechanism, name)) == identity for name, _, identity in tables
            ):
                return result
        reading = TablesRead(mechanism)
        result = build(cast(Mechanism, reading), *others)
        # a table that is kept stays alive: no other object gets its identity
        tables = [(name, _content(table), _identity(table)) for name, table in reading.tables.items()]
        kept = ((tables, others, result), *kept)[:KEPT]  # one assignment, whatever other threads do
        return result

    return function


def _same(one: Any, other: Any) -> bool:
    return one is other


def _content(table: Any) -> Any:
    """Return a table, or the entries of a dict of tables, to which somebody may give others."""
    return list(table.values()) if isinstance(table, Mapping) else table


def _identity(table: Any) -> Any:
    """Return what only the same table has, or a dict of the same entries."""
    return (list(table), list(map(id, table.values()))) if isinstance(table, Mapping) else id(table)
