"""Keep the names of an earlier revision for the parts, joints and stops that are still present in a new one.

A person may have changed them: names in the mechanism file come before those that would be proposed.

A stop or a joint gets a number if several are alike. Without this module, a new one would take the number of another
one, together with what a person has written about that one.
"""

import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Any, TypeVar

import numpy as np

from engine.arrays import Array
from engine.cad.cad_model import CadAssembly, CadPart
from engine.cad_import.found_geometry import FoundBall, FoundGeometry, FoundJoint, FoundStop, find_geometry
from engine.cad_import.proposed_groups import PartGroup, updated_groups
from engine.cad_import.proposed_stops import stop_sides
from engine.cad_import.proposed_text import entries_of
from engine.mechanism.geometry.part_bodies import parts_of_body

_FAR = 5.0  # mm between two positions of the same stop
_ALIKE = 1e-6  # relative difference of the volumes and inertias of a renamed part
_SAME_PLACE = 1e-3  # mm between the two centres of a renamed part
_Found = TypeVar("_Found", FoundJoint, FoundBall, FoundStop)

_SAME = 0.5  # mm from the position of a stop according to the file
_STOP_PLACES = (
    *((kind, "near") for kind in ("plane", "pin", "hole")),
    *((kind, "centre") for kind in ("sphere", "socket")),
    *((kind, "point") for kind in ("extruded", "turned")),
    ("surface", "faces", 0, "near"),
)
"""The keys at which the side b of a proposed stop holds a point."""


@dataclass(frozen=True, eq=False)
class NamedPlace:
    """The position of a named feature."""

    name: str
    kind: tuple[Any, ...]  # only features of the same kind can be the same
    point: Array  # shape (3,) [mm]


def named_as_before(found: FoundGeometry, before: FoundGeometry) -> FoundGeometry:
    """Return the features found, with the names that the same parts, joints and stops had in an earlier revision.

    Parts of one product, and joints between two parts, are matched with the nearest earlier ones. A part of a new
    product is matched with one of a product that has disappeared, if its solids have the same volume and inertia and
    are in the same place. A stop is matched with an earlier one within 5 mm with the same normal. All others get names
    that the earlier revision did not have.
    """
    names = matched(_parts(found, _former_products(found.assembly, before.assembly)), _parts(before, {}))
    found = replace(found, bodies=dict(zip(found.bodies, names, strict=True)))
    names = matched(places_of_joints(found), places_of_joints(before))
    joints = renamed(found.joints, names[: len(found.joints)])
    balls = renamed(found.balls, names[len(found.joints) :])
    stops = renamed(found.stops, matched(places_of_stops(found), places_of_stops(before), _FAR))
    return replace(found, joints=joints, balls=balls, stops=stops)


def _parts(found: FoundGeometry, products: Mapping[str, str]) -> list[NamedPlace]:
    """Return the parts, each as one of its own product, or of the product that a mapping gives for the part."""
    return [
        NamedPlace(found.bodies[p.name], (products.get(p.name, p.product),), p.bounds.mean(axis=0))
        for p in found.assembly.parts
    ]


def _former_products(now: CadAssembly, before: CadAssembly) -> dict[str, str]:
    """Return the earlier product of each part that has been renamed."""
    new = {part.product for part in now.parts} - {part.product for part in before.parts}
    gone = {part.product for part in before.parts} - {part.product for part in now.parts}
    return {
        part.name: former.product
        for part in now.parts
        if part.product in new
        for former in before.parts
        if former.product in gone and _is_same(part, former)
    }


def revised_groups(listed: Sequence[PartGroup], before: CadAssembly, now: CadAssembly) -> list[PartGroup]:
    """Return the groups of a new revision: as a person listed them for the earlier one, with new parts as proposed."""
    former = _former_products(now, before)
    products = {former.get(part.name, part.product): part.product for part in now.parts}
    stays = {part.name for part in now.parts}
    names = {part.name: part.name for part in before.parts if part.name in stays}
    for part in before.parts:
        again = [new.name for new in now.parts if new.product == products.get(part.product) and _is_same(new, part)]
        if part.name not in names and again:
            names[part.name] = again[0]
    proposed = find_geometry(now).groups if set(stays) - set(names.values()) else ()
    return updated_groups(listed, proposed, names, [part.name for part in now.parts])


def _is_same(part: CadPart, former: CadPart) -> bool:
    """Return whether two parts have the same solids in the same place."""
    if not part.solids or len(part.solids) != len(former.solids):
        return False
    return all(
        abs(one.volume - other.volume) <= _ALIKE * abs(other.volume)
        and float(np.linalg.norm(one.centre - other.centre)) <= _SAME_PLACE
        and bool(np.all(np.abs(one.inertia - other.inertia) <= _ALIKE * np.abs(other.inertia).max()))
        for one, other in zip(part.solids, former.solids, strict=True)
    )


def renamed_parts(found: FoundGeometry, before: FoundGeometry) -> list[tuple[str, str, str]]:
    """Return body, earlier name and new name of each renamed part; `found` is from `named_as_before`."""
    parts = {body: part for part, body in found.bodies.items()}
    return [(body, part, parts[body]) for part, body in before.bodies.items() if parts.get(body, part) != part]


def places_of_joints(found: FoundGeometry) -> list[NamedPlace]:
    """Return the joints with pins and with balls, each in the frame of the body around it."""
    pins = [(j.name, (j.pin.journal, j.pin.bearing), j.pin.point) for j in found.joints]
    balls = [(b.name, (b.ball.ball_part, b.ball.socket_part), b.ball.centre) for b in found.balls]
    return [
        NamedPlace(name, (found.bodies[parts[0]], found.bodies[parts[1]]), found.to_body(parts[1], point))
        for name, parts, point in [*pins, *balls]
    ]


def places_of_stops(found: FoundGeometry) -> list[NamedPlace]:
    """Return the stops, each in the frame of the body with its plane."""
    places = []
    for stop in found.stops:
        plane, other = stop.pair.parts
        normal = found.assembly.part(plane).placement.rotation.T @ stop.pair.normal
        kind = (found.bodies[plane], found.bodies[other], *(np.round(normal, 1) + 0.0).tolist())
        places.append(NamedPlace(stop.name, kind, found.to_body(plane, stop.pair.middle)))
    return places


def matched(now: list[NamedPlace], before: list[NamedPlace], most: float = np.inf) -> list[str]:
    """Return a name for each place: that of the nearest earlier one of its kind, nearest pairs first, or a new name."""
    pairs = [
        (float(np.linalg.norm(here.point - there.point)), i, j)
        for i, here in enumerate(now)
        for j, there in enumerate(before)
        if here.kind == there.kind
    ]
    names: dict[int, str] = {}
    # nearest pairs first over all places, or a new joint could take the name of a neighbour that is still there
    for far, i, j in sorted(pairs):
        if far <= most and i not in names and before[j].name not in names.values():
            names[i] = before[j].name
    taken = {place.name for place in before}
    for i, place in enumerate(now):
        if i not in names:
            names[i] = _free(place.name, taken)
            taken.add(names[i])
    return [names[i] for i in range(len(now))]


def _free(name: str, taken: set[str]) -> str:
    """Return a free name: the name itself, or the name with the next free number."""
    stem = re.sub(r"-\d+$", "", name)
    first = 2 if stem == name else 1
    return name if name not in taken else next(each for n in count(first) if (each := f"{stem}-{n}") not in taken)


def renamed(found: Sequence[_Found], names: list[str]) -> tuple[_Found, ...]:
    """Return features with other names, in the same order."""
    return tuple(replace(each, name=name) for each, name in zip(found, names, strict=True))


# The names in a mechanism file of the features found in its CAD file; a person may have changed them.


def named_as_written(found: FoundGeometry, text: str) -> FoundGeometry:
    """Return the features of a mechanism file's CAD file with their names in its text, marked tables included."""
    tables = _tables(text)
    of_parts = [(name, parts_of_body(table)) for kind, name, table in tables if kind == "bodies"]
    bodies = {found.whole(parts[0]): name for name, parts in of_parts if parts}
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
