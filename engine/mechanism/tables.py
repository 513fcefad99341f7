"""Read tables of a file that may contain faults: a part of the wrong type counts as empty, and nothing is raised."""

from collections.abc import Mapping, Sequence
from typing import Any


def as_table(value: Any) -> Mapping[str, Any]:
    """Return ``value`` if it is a table, otherwise an empty one."""
    return value if isinstance(value, Mapping) else {}


def sub_table(data: Any, key: str) -> Mapping[str, Any]:
    """Return the table under ``key``; empty if there is none."""
    return as_table(as_table(data).get(key))


def named_tables(data: Any, key: str) -> dict[str, Mapping[str, Any]]:
    """Return the tables inside the table under ``key`` by name, such as all joints."""
    return {name: as_table(entry) for name, entry in sub_table(data, key).items()}


def list_under(data: Any, key: str) -> Sequence[Any]:
    """Return the list under ``key``; empty if there is none."""
    value = as_table(data).get(key)
    return value if isinstance(value, list | tuple) else ()


def phase_names(data: Mapping[str, Any]) -> list[str]:
    """Return the names of the phases; a file without phases has one, called ``run``."""
    return [str(as_table(phase).get("name")) for phase in list_under(data, "phases")] or ["run"]
