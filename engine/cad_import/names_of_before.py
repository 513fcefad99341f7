"""Keep the names of an earlier revision for the parts, joints and stops that are still present in a new one.

A stop or a joint gets a number if several are alike. Without this module, a new one would take the number of another
one, together with what a person has written about that one.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Any, TypeVar

import numpy as np

from engine.arrays import Array
from engine.cad.cad_model import CadAssembly, CadPart
from engine.cad_import.found_geometry import FoundBall, FoundGeometry, FoundJoint, FoundStop

_FAR = 5.0  # mm between two positions of the same stop
_ALIKE = 1e-6  # relative difference of the volumes and inertias of a renamed part
_SAME_PLACE = 1e-3  # mm between the two centres of a renamed part
_Found = TypeVar("_Found", FoundJoint, FoundBall, FoundStop)


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
