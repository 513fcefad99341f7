"""Pins in holes: coaxial cylinders of two parts, one inside the other; and near misses, each with the reason.

A slot is two half holes with parallel axes that are open towards each other. A pin that slides in one is a near miss,
although either end of the slot looks like a joint.
"""

from dataclasses import dataclass
from itertools import combinations
from math import degrees, pi, radians

import numpy as np

from engine.arrays import Array
from engine.cad.cad_model import CadAssembly, CadFace, Coordinates, Millimetres

_HALF_TURN = 0.02  # rad by which the end of a slot may differ from half a turn
_ENDS_PARALLEL = 1e-4  # rad
_ENDS_ALIKE = 1e-6  # relative difference of equal radii, and distance of coinciding ends in mm

LEAST_SPAN = radians(160.0)
"""Smallest span of a hole and of a pin [rad]: less than half a turn holds nothing."""
MOST_CLEARANCE = 0.3
"""Largest difference of radii [mm] at which a hole still guides a pin."""
MOST_EXCESS = 0.12
"""Largest offset of the axes beyond the clearance [mm] that a drawn pose may have."""
_LEAST_SNAP = radians(60.0)
_LOOSEST_SNAP, _SQUEEZED = 0.5, 0.05  # mm by which an open bearing may be wider, or narrower, than its pin
_NEAR = 1.0
"""Differences of radii and offsets [mm] up to which a refused pair is reported."""
_PARALLEL = radians(2.0)
_ALIKE = 1e-6  # mm between two radii that count as equal

_ALONG_SLOT = 0.035  # rad between the axes of a slot and of its pin


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
    alike = abs(a.radius - b.radius) <= _ENDS_ALIKE * a.radius and abs(a.axis @ b.axis) > np.cos(_ENDS_PARALLEL)
    if not alike or length < _ENDS_ALIKE or a.solid != b.solid:
        return False
    opposite = a.middle @ way < -np.cos(_HALF_TURN) * length and b.middle @ way > np.cos(_HALF_TURN) * length
    between = float((b.point - a.point) @ a.axis)
    shared = min(a.extent[1], between + b.extent[1]) - max(a.extent[0], between + b.extent[0])
    return bool(opposite and shared > 0)


@dataclass(frozen=True, eq=False, kw_only=True)
class Seat:
    """A section of the axis in which a hole surrounds a pin."""

    hole: int
    """Number of the face."""
    pin: int
    hole_radius: Millimetres
    pin_radius: Millimetres
    start: Millimetres
    """Position along the joint's axis, measured from its point [mm]."""
    end: Millimetres


@dataclass(frozen=True, eq=False, kw_only=True)
class PinInHole:
    """A joint of two parts: all holes of one around all pins of the other on a common axis."""

    bearing: str
    """The part with the hole."""
    journal: str
    """The part with the pin."""
    point: Coordinates
    """On the hole's axis, midway along its seats, shape (3,) [mm]."""
    axis: Array
    journal_point: Coordinates
    """On the pin's axis, at the same position along it, shape (3,) [mm]."""
    journal_axis: Array
    """Unit vector, pointing the same way as `axis`."""
    seats: tuple[Seat, ...]
    """Ordered along the axis."""
    radial_clearance: Millimetres
    """As drawn, the smallest difference of radii; 0 if both have the same radius."""
    offset: Millimetres
    """Largest distance between the two axes along the seats [mm]."""
    tilt: float
    """Angle between the two axes [rad]."""

    overlap: Millimetres
    """How far pin and hole overlap as posed [mm]; 0 where the pin lies within its clearance."""

    @property
    def rings(self) -> tuple[tuple[float, Seat], ...]:
        """Stations [mm] of the rings that carry the pin, each with its seat: one at each end of each pair of radii."""
        first, last = self.seats[0], self.seats[-1]
        radii = np.array([(seat.hole_radius, seat.pin_radius) for seat in self.seats])
        if np.ptp(radii, axis=0).max() < _ALIKE:
            return (first.start, first), (last.end, last)
        return tuple((station, seat) for seat in self.seats for station in (seat.start, seat.end))


@dataclass(frozen=True, kw_only=True)
class NearMiss:
    """A pin and a hole that are not accepted as a joint."""

    hole: int
    pin: int
    reason: str
    may_be_one: bool = False
    """Whether it was refused only by the limits of this module."""
    snaps: bool = False
    """Whether the hole may be a bearing into which the pin snaps: it fits, but the hole does not close around it."""
    unlikely: int = 0
    """Rank among the pairs that are not joints: 0 for the most plausible ones."""


@dataclass(frozen=True)
class _Pair:
    """A hole and a pin that are nearly coaxial."""

    hole: CadFace
    pin: CadFace
    start: float
    """Position along the hole's axis, measured from its point [mm]."""
    end: float
    offset: float

    @property
    def clearance(self) -> float:
        return self.hole.radius - self.pin.radius


def pins_in_holes(assembly: CadAssembly) -> tuple[list[PinInHole], list[NearMiss]]:
    """Return the pins in holes of an assembly in mm, in the order of the parts, and the near misses.

    A near miss is a pair whose radii and axes differ by less than 1 mm, but which is neither a joint nor part of one.
    """
    cylinders = [face for face in assembly.faces if face.kind == "cylinder"]
    slots = slots_of([face for face in cylinders if face.hollow])
    ends = {end.number for slot in slots for end in slot.ends}  # a pin is not held there, because it can slide away
    holes = [face for face in cylinders if face.hollow and face.number not in ends]
    pins = [face for face in cylinders if not face.hollow]
    pairs = [(pair, _refusal(pair)) for pair in _near_pairs(holes, pins)]
    accepted = [pair for pair, reason in pairs if not reason]
    refused = [
        NearMiss(
            hole=pair.hole.number,
            pin=pair.pin.number,
            reason=reason,
            may_be_one=_is_loose(pair),
            snaps=_snaps(pair),
            unlikely=_unlikely(pair),
        )
        for pair, reason in pairs
        if reason and not any(_of_one_joint(pair, other) for other in accepted)
    ]
    return [_joint(group) for group in _grouped(accepted)], refused


def pin_in_hole(hole: CadFace, pin: CadFace) -> PinInHole:
    """Return the joint of one hole and one pin, both cylinders in mm, whether or not they qualify as one."""
    return _joint([_pair(hole, pin)])


def coaxial_fits(assembly: CadAssembly) -> list[tuple[CadFace, CadFace]]:
    """Return the holes and pins of two parts that share a stretch of one axis, whatever their radii.

    Besides joints, these are screws in clearance holes, threads drawn as cylinders, and press fits.
    """
    cylinders = [face for face in assembly.faces if face.kind == "cylinder" and face.span > LEAST_SPAN]
    holes, pins = [f for f in cylinders if f.hollow], [f for f in cylinders if not f.hollow]
    pairs = [pair for pair in _near_pairs(holes, pins) if pair.end > pair.start]
    return [(pair.hole, pair.pin) for pair in pairs if pair.offset <= max(pair.clearance, 0.0) + MOST_EXCESS]


def _near_pairs(holes: list[CadFace], pins: list[CadFace]) -> list[_Pair]:
    """Return all pairs of a hole and a pin of two parts whose radii and axes differ little."""
    if not holes or not pins:
        return []
    near = np.abs(np.subtract.outer([f.radius for f in holes], [f.radius for f in pins])) <= _NEAR
    axes = np.array([f.axis for f in holes]), np.array([f.axis for f in pins])
    near &= np.abs(axes[0] @ axes[1].T) >= np.cos(_PARALLEL)
    between = np.array([f.point for f in pins]) - np.array([f.point for f in holes])[:, None]
    along = np.einsum("ijk,ik->ij", between, axes[0])
    near &= np.linalg.norm(between - along[:, :, None] * axes[0][:, None], axis=2) <= 2 * _NEAR
    pairs = [_pair(holes[i], pins[j]) for i, j in np.argwhere(near) if holes[i].part != pins[j].part]
    return [pair for pair in pairs if pair.offset <= _NEAR]


def _pair(hole: CadFace, pin: CadFace) -> _Pair:
    """Return where a hole surrounds a pin, and the distance of the axes there."""
    stations = np.sort((pin.point + np.outer(pin.extent, pin.axis) - hole.point) @ hole.axis)
    start, end = max(hole.extent[0], stations[0]), min(hole.extent[1], stations[1])
    at = hole.point + np.outer((start, end), hole.axis)
    away = at - pin.point
    away -= np.outer(away @ pin.axis, pin.axis)
    return _Pair(hole, pin, float(start), float(end), float(np.linalg.norm(away, axis=1).max()))


def _refusal(pair: _Pair) -> str:
    """Return why a pair is not a joint; empty if it is one."""
    for name, face in (("hole", pair.hole), ("pin", pair.pin)):
        if face.span <= LEAST_SPAN:
            return f"only {degrees(face.span):.0f} degrees of the {name} are there; allowed: more than 160"
    if abs(pair.start - pair.end) <= _ALIKE:
        return "they meet end to end along the axis"
    if pair.end <= pair.start:
        return f"they lie {pair.start - pair.end:.3g} mm apart along the axis"
    gaps = pair.hole.recognition_gap + pair.pin.recognition_gap + 1e-6
    if pair.clearance < -gaps:
        return f"the pin is {-pair.clearance:.3g} mm larger in radius than the hole: a press fit, or an error"
    if pair.clearance > MOST_CLEARANCE:
        return f"the radii differ by {pair.clearance:.3g} mm; allowed: up to {MOST_CLEARANCE:g}"
    allowed = max(pair.clearance, 0.0) + MOST_EXCESS
    if pair.offset > allowed:
        return f"the axes are {pair.offset:.3g} mm apart; allowed: the clearance + {MOST_EXCESS:g}, so {allowed:.3g}"
    return ""


def _snaps(pair: _Pair) -> bool:
    """Return whether a hole that does not close could hold a pin that is snapped into it."""
    open_hole = _LEAST_SNAP < pair.hole.span <= LEAST_SPAN < pair.pin.span
    fits = -_SQUEEZED <= pair.clearance <= _LOOSEST_SNAP
    return open_hole and fits and pair.end > pair.start and pair.offset <= max(pair.clearance, 0.0) + MOST_EXCESS


def _unlikely(pair: _Pair) -> int:
    """Return the rank of a pair that is not a joint, 0 for the most plausible ones."""
    if _is_loose(pair) or _snaps(pair):
        return 0
    if pair.end <= pair.start:
        return 3
    return 2 if min(pair.hole.span, pair.pin.span) <= LEAST_SPAN else 1


def _is_loose(pair: _Pair) -> bool:
    """Return whether a hole holds a pin, but with more clearance than is accepted for a joint."""
    spans = min(pair.hole.span, pair.pin.span)
    return spans > LEAST_SPAN and pair.end > pair.start and pair.clearance > max(MOST_CLEARANCE, pair.offset)


def _grouped(pairs: list[_Pair]) -> list[list[_Pair]]:
    """Return the pairs of each joint, i.e. of the same two parts on the same axis."""
    groups: list[list[_Pair]] = []
    for pair in pairs:
        for group in groups:
            if _of_one_joint(group[0], pair):
                group.append(pair)
                break
        else:
            groups.append([pair])
    return groups


def _of_one_joint(a: _Pair, b: _Pair) -> bool:
    """Return whether two pairs belong to the same two parts and lie on the same axis."""
    return (a.hole.part, a.pin.part) == (b.hole.part, b.pin.part) and _on_one_axis(a.hole, b.hole)


def _on_one_axis(a: CadFace, b: CadFace) -> bool:
    """Return whether two holes of a part are coaxial."""
    away = b.point - a.point
    apart = np.linalg.norm(away - (away @ a.axis) * a.axis)
    return bool(apart <= MOST_EXCESS and abs(a.axis @ b.axis) >= np.cos(_PARALLEL))


def _joint(group: list[_Pair]) -> PinInHole:
    """Return the joint made up of the pairs on one axis."""
    hole, pin = group[0].hole, group[0].pin
    stretches = []
    for pair in group:
        shift, turn = (pair.hole.point - hole.point) @ hole.axis, np.sign(pair.hole.axis @ hole.axis)
        stretches.append(sorted((float(shift + turn * pair.start), float(shift + turn * pair.end))))
    ends = np.array(stretches)
    middle = float(ends.min() + ends.max()) / 2
    point = hole.point + middle * hole.axis
    journal_axis = pin.axis * np.sign(pin.axis @ hole.axis)
    along = (point - pin.point) @ hole.axis / (journal_axis @ hole.axis)
    seats = [
        Seat(
            hole=pair.hole.number,
            pin=pair.pin.number,
            hole_radius=pair.hole.radius,
            pin_radius=pair.pin.radius,
            start=start - middle,
            end=end - middle,
        )
        for pair, (start, end) in zip(group, stretches, strict=True)
    ]
    clearance = min(pair.clearance for pair in group)
    gaps = max(pair.hole.recognition_gap + pair.pin.recognition_gap for pair in group) + 1e-9
    offset = max(pair.offset for pair in group)
    overlap = offset - max(clearance, 0.0)
    return PinInHole(
        bearing=hole.part,
        journal=pin.part,
        point=point,
        axis=hole.axis,
        journal_point=pin.point + along * journal_axis,
        journal_axis=journal_axis,
        seats=tuple(sorted(seats, key=lambda seat: seat.start)),
        radial_clearance=clearance if clearance > gaps else 0.0,
        offset=offset,
        overlap=overlap if overlap > gaps else 0.0,
        tilt=float(np.arcsin(min(1.0, float(np.linalg.norm(np.cross(hole.axis, journal_axis)))))),
    )


# -- pins in slots ----------------------------------------------------------------------------------------------------


def pins_in_slots(assembly: CadAssembly) -> list[NearMiss]:
    """Return the pins in slots of an assembly in mm, each with what to write instead of a joint."""
    cylinders = [face for face in assembly.faces if face.kind == "cylinder"]
    pins = [face for face in cylinders if not face.hollow]
    found = []
    for slot in slots_of([face for face in cylinders if face.hollow]):
        hole = slot.ends[0]
        text = (
            f"the hole is a slot, in which the pin slides {np.linalg.norm(slot.way):.4g} mm; write contacts of the pin"
            " with its flat sides and, where it gets there, its ends"
        )
        sliding = [pin for pin in pins if _fits(hole, pin) and slot.distance(pin) <= _allowed(hole, pin)]
        found += [NearMiss(hole=hole.number, pin=pin.number, reason=text) for pin in sliding]
    return found


def _fits(hole: CadFace, pin: CadFace) -> bool:
    """Return whether a pin of another part is as thick as the slot is wide, parallel to it and next to it."""
    if pin.part == hole.part or not -_ALIKE <= hole.radius - pin.radius <= MOST_CLEARANCE:
        return False
    stations = np.sort((pin.point + np.outer(pin.extent, pin.axis) - hole.point) @ hole.axis)
    shared = min(hole.extent[1], stations[1]) - max(hole.extent[0], stations[0])
    return bool(abs(hole.axis @ pin.axis) >= np.cos(_ALONG_SLOT) and shared > 0)


def _allowed(hole: CadFace, pin: CadFace) -> float:
    """Return the allowed distance of a pin from the middle plane of its slot [mm]."""
    return max(hole.radius - pin.radius, 0.0) + MOST_EXCESS
