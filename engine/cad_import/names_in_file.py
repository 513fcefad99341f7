"""The names in a mechanism file of the features found in its CAD file; a person may have changed them."""

import tomllib
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from engine.arrays import Array
from engine.cad_import.found_geometry import FoundGeometry
from engine.cad_import.names_of_before import NamedPlace, matched, places_of_joints, renamed
from engine.cad_import.proposed_stops import stop_sides
from engine.cad_import.proposed_text import entries_of

_SAME = 0.5  # mm from the position of a stop according to the file
_STOP_PLACES = (
    *((kind, "near") for kind in ("plane", "pin", "hole")),
    *((kind, "centre") for kind in ("sphere", "socket")),
    *((kind, "point") for kind in ("extruded", "turned")),
    ("surface", "faces", 0, "near"),
)
"""The keys at which the side b of a proposed stop holds a point."""


def named_as_written(found: FoundGeometry, text: str) -> FoundGeometry:
    """Return the features of a mechanism file's CAD file with their names in its text, marked tables included."""
    tables = _tables(text)
    bodies = {table.get("part"): name for kind, name, table in tables if kind == "bodies"}
    found = replace(found, bodies={part: bodies.get(part, name) for part, name in found.bodies.items()})
    written = [place for kind, name, table in tables if kind == "joints" for place in _joint(name, table)]
    names = matched(places_of_joints(found), written)
    count = len(found.joints)
    joints, balls = renamed(found.joints, names[:count]), renamed(found.balls, names[count:])
    stops = [place for kind, name, table in tables if kind == "contacts" for place in _stop(name, table)]
    proposed = [(stop.name, *stop_sides(found, stop)) for stop in found.stops]
    of_stops = [place for name, a, b in proposed for place in _stop(name, {"a": a, "b": b})]
    return replace(found, joints=joints, balls=balls, stops=renamed(found.stops, matched(of_stops, stops, _SAME)))


def _tables(text: str) -> list[tuple[str, str, dict[str, Any]]]:
    """Return kind, name and keys of each named table; lines that cannot be read on their own are skipped."""
    found: dict[str, dict[str, Any]] = {}
    for (header, key), entry in entries_of(text.splitlines()).items():
        table = found.setdefault(header.strip("[]"), {})
        try:
            table |= tomllib.loads(f"{key} = {entry.value}") if key else {}
        except tomllib.TOMLDecodeError:  # a value that continues on the next line
            continue
    return [(*header.split("."), table) for header, table in found.items() if header.count(".") == 1]  # type: ignore[misc]


def _joint(name: str, table: dict[str, Any]) -> Iterator[NamedPlace]:
    """Yield the position of a joint in the body around its pin or ball."""
    for outer, inner, where in (("bearing", "journal", ("hole", "near")), ("socket", "ball", ("point",))):
        point = _point(table, outer, *where)
        if point is not None:
            yield NamedPlace(name, (_body(table, inner), _body(table, outer)), point)


def _stop(name: str, table: dict[str, Any]) -> Iterator[NamedPlace]:
    """Yield the position of a stop in the body of its side b, and the kind of that side."""
    for kind, *where in _STOP_PLACES:
        point = _point(table, "b", kind, *where)
        if point is not None:
            yield NamedPlace(name, (kind, _body(table, "b"), _body(table, "a")), point)


def _body(table: dict[str, Any], side: str) -> str:
    entry = table.get(side)
    return str(entry.get("body")) if isinstance(entry, dict) else ""


def _point(table: dict[str, Any], *path: str | int) -> Array | None:
    """Return a point in a table; None if there is no list of three numbers."""
    entry: Any = table
    for key in path:
        if isinstance(key, int):
            entry = entry[key] if isinstance(entry, list) and key < len(entry) else None
        else:
            entry = entry.get(key) if isinstance(entry, dict) else None
    if isinstance(entry, list | np.ndarray) and len(entry) == 3 and all(isinstance(x, int | float) for x in entry):
        return np.array(entry, float)
    return None
