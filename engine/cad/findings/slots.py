"""Slots: two half holes with parallel axes that are open towards each other, between which a pin slides."""

from dataclasses import dataclass
from itertools import combinations
from math import pi

import numpy as np

from engine.arrays import Array
from engine.cad.cad_model import CadFace

_HALF_TURN = 0.02  # rad by which the end of a slot may differ from half a turn
_PARALLEL = 1e-4  # rad
_ALIKE = 1e-6  # relative difference of equal radii, and distance of coinciding ends in mm


@dataclass(frozen=True, eq=False, kw_only=True)
class Slot:
    """A slot, given by its two round ends, which are faces of one part."""

    ends: tuple[CadFace, CadFace]

    @property
    def way(self) -> Array:
        """Vector from the axis of one end to that of the other, perpendicular to both [mm], shape (3,)."""
        return _across(*self.ends)

    def distance(self, pin: CadFace) -> float:
        """Return the distance of a pin's axis from the middle plane of the slot, or from its ends [mm]."""
        first = self.ends[0]
        away = _across(first, pin)
        share = float(np.clip(away @ self.way / (self.way @ self.way), 0.0, 1.0))
        return float(np.linalg.norm(away - share * self.way))


def slots_of(holes: list[CadFace]) -> list[Slot]:
    """Return the slots among the hollow cylinders of an assembly."""
    halves: dict[str, list[CadFace]] = {}
    for hole in holes:
        if abs(hole.span - pi) < _HALF_TURN:
            halves.setdefault(hole.part, []).append(hole)
    return [Slot(ends=(a, b)) for alike in halves.values() for a, b in combinations(alike, 2) if _are_ends_of_one(a, b)]


def _across(first: CadFace, other: CadFace) -> Array:
    """Return the vector from one axis to another, perpendicular to the first, shape (3,)."""
    away = other.point - first.point
    return np.asarray(away - (away @ first.axis) * first.axis)


def _are_ends_of_one(a: CadFace, b: CadFace) -> bool:
    """Return whether two half holes are open towards each other, equal in radius, and side by side along their axes."""
    way = _across(a, b)
    length = float(np.linalg.norm(way))
    alike = abs(a.radius - b.radius) <= _ALIKE * a.radius and abs(a.axis @ b.axis) > np.cos(_PARALLEL)
    if not alike or length < _ALIKE or a.solid != b.solid:
        return False
    opposite = a.middle @ way < -np.cos(_HALF_TURN) * length and b.middle @ way > np.cos(_HALF_TURN) * length
    between = float((b.point - a.point) @ a.axis)
    shared = min(a.extent[1], between + b.extent[1]) - max(a.extent[0], between + b.extent[0])
    return bool(opposite and shared > 0)
