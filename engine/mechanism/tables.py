"""Tables of a file that may be faulty: whatever is there is looked at, nothing raises."""

from collections.abc import Mapping
from typing import Any


def sub_table(data: Any, name: str) -> Mapping[str, Any]:
    """Return a sub-table, empty when it is absent or no table."""
    found = data.get(name) if isinstance(data, Mapping) else None
    return found if isinstance(found, Mapping) else {}


def phase_names(data: Mapping[str, Any]) -> list[str]:
    """Return the names of the phases."""
    phases = data.get("phases")
    named = [str(sub_table({"p": p}, "p").get("name")) for p in phases] if isinstance(phases, list | tuple) else []
    return named or ["run"]
