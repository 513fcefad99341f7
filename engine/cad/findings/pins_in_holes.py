"""Pins in holes: coaxial cylinders of two parts, one inside the other; and near misses, each with the reason."""

from dataclasses import dataclass
from math import degrees, radians

import numpy as np

from engine.arrays import Array
from engine.cad.cad_model import CadAssembly, CadFace, Coordinates, Millimetres
from engine.cad.findings.slots import slots_of

LEAST_SPAN = radians(160.0)
"""Smallest span of a hole and of a pin [rad]: less than half a turn holds nothing."""
MOST_CLEARANCE = 0.3
"""Largest difference of radii [mm] at which a hole still guides a pin."""
MOST_EXCESS = 0.12
"""Largest offset of the axes beyond the clearance [mm] that a drawn pose may have."""
_NEAR = 1.0
"""Differences of radii and offsets [mm] up to which a refused pair is reported."""
_PARALLEL = radians(2.0)
_ALIKE = 1e-6  # mm between two radii that count as equal


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
        NearMiss(hole=pair.hole.number, pin=pair.pin.number, reason=reason, may_be_one=_is_loose(pair))
        for pair, reason in pairs
        if reason and not any(_of_one_joint(pair, other) for other in accepted)
    ]
    return [_joint(group) for group in _grouped(accepted)], refused


def pin_in_hole(hole: CadFace, pin: CadFace) -> PinInHole:
    """Return the joint of one hole and one pin, both cylinders in mm, whether or not they qualify as one."""
    return _joint([_pair(hole, pin)])


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
