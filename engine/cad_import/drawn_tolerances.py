"""What the CAD file says of tolerances (semantic PMI of AP242): diameters and zones of joints that a campaign varies.

Limits and zones on anything else are not used, and said to be: only a person knows which number of the mechanism they
are about.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from engine.cad.cad_model import GeometricTolerance, SizeLimits
from engine.cad_import.found_geometry import FoundGeometry, FoundJoint

_SIDES = {"hole": "bearing", "pin": "journal"}
_PLACES, _DIRECTIONS = ("position", "coaxiality"), ("parallelism", "perpendicularity", "angularity")


@dataclass(frozen=True)
class Diameter:
    """A diameter with limits that the CAD file attaches to the hole or the pin of a joint."""

    parameter: str  # its name in the mechanism file
    value: float  # there [mm], like both limits
    lower: float
    upper: float
    words: str  # of the drawing
    tolerance_class: str = ""  # of ISO 286, if it has one


@dataclass(frozen=True)
class Zone:
    """A zone of the axis of a hole or a pin; how far the axis is off or tilted, and to which side, are variables."""

    words: str  # of the drawing
    stem: str  # the beginning of the names of its variables
    keys: str  # of the deviation in the mechanism file
    what: Literal["off", "tilt"]
    width: float  # its diameter [mm]; of a tilt, twice the largest one [rad]; 2 if the variable is a share
    share: str = ""  # with (M) the variable is a share of the zone's radius, a parameter of this name,
    off: str = ""  # and the distance an expression

    @property
    def variable(self) -> str:
        """The variable of the distance, the share or the tilt."""
        return self.share or f"{self.stem}_{self.what}"

    @property
    def target(self) -> str:
        """The key that this variable sets."""
        return f"parameters.{self.share}" if self.share else f"{self.keys}.{self.what}"

    @property
    def way(self) -> str:
        """The key of the direction in the deviation."""
        return "way" if self.what == "off" else "tilt_way"


def stem_of(joint: FoundJoint) -> str:
    """Return the beginning of the names of a joint's parameters and variables."""
    return joint.name.replace("-", "_")


def limits_of(found: FoundGeometry, joint: FoundJoint) -> dict[str, SizeLimits]:
    """Return the limits of the diameters of a joint with one seat, under ``hole`` and ``pin``; else empty."""
    if len(joint.pin.seats) > 1:
        return {}
    [seat] = joint.pin.seats
    return {
        side: limits
        for side, number in (("hole", seat.hole), ("pin", seat.pin))
        for limits in found.assembly.limits
        if limits.faces == (number,) and limits.kind in ("diameter", "radius")
    }


def diameters_of(found: FoundGeometry, joint: FoundJoint) -> dict[str, Diameter]:
    """Return the diameters that limits give a joint, under ``hole`` and ``pin``; empty if they leave it no play.

    They are the nominal ones, or the middles of the limits if there is no play between nominal ones, as in a fit. If
    both are drawn equal, both need limits.
    """
    limits = limits_of(found, joint)
    if not limits or (joint.pin.radial_clearance <= 0 and len(limits) < len(_SIDES)):
        return {}
    [seat] = joint.pin.seats
    drawn = {"hole": 2 * seat.hole_radius, "pin": 2 * seat.pin_radius}
    nominal = {side: _diameter(f"{stem_of(joint)}_{side}", each) for side, each in limits.items()}
    middle = {side: replace(each, value=round((each.lower + each.upper) / 2, 9)) for side, each in nominal.items()}
    for made in (nominal, middle):
        sizes = drawn | {side: each.value for side, each in made.items()}
        if sizes["hole"] > sizes["pin"]:
            return made
    return {}


def all_diameters(found: FoundGeometry) -> list[Diameter]:
    """Return the diameters with limits of all joints."""
    return [each for joint in found.joints for each in diameters_of(found, joint).values()]


def _diameter(parameter: str, limits: SizeLimits) -> Diameter:
    factor = 2.0 if limits.kind == "radius" else 1.0
    nominal, lower, upper = (round(factor * size, 9) for size in (limits.nominal, limits.lower, limits.upper))
    return Diameter(parameter, nominal, lower, upper, limits.words, limits.tolerance_class)


def _zones_of(found: FoundGeometry, joint: FoundJoint, side: str) -> dict[GeometricTolerance, Zone]:
    """Return the zones that are used on the hole or the pin of a joint with one seat: one of a place, one of a tilt."""
    if len(joint.pin.seats) > 1:
        return {}
    [seat] = joint.pin.seats
    number = seat.hole if side == "hole" else seat.pin
    widest = 2 * found.face(number).radius  # a wider one is of another unit
    on = [each for each in found.assembly.zones if each.faces == (number,) and _is_usable(each) and each.zone < widest]
    used = {}
    sought: tuple[tuple[tuple[str, ...], Literal["off", "tilt"]], ...] = ((_PLACES, "off"), (_DIRECTIONS, "tilt"))
    for kinds, what in sought:
        # of several frames below each other, the widest is about the datums
        of_kind = sorted((each for each in on if each.kind in kinds), key=lambda each: -each.zone)
        if of_kind and (zone := _zone(found, joint, side, of_kind[0], what)):
            used[of_kind[0]] = zone
    return used


def _is_usable(zone: GeometricTolerance) -> bool:
    return (
        zone.round and zone.zone > 0 and not zone.modifiers and not (zone.maximum_material and zone.kind in _DIRECTIONS)
    )


def _zone(
    found: FoundGeometry, joint: FoundJoint, side: str, zone: GeometricTolerance, what: Literal["off", "tilt"]
) -> Zone | None:
    """Return a zone as variables; None if its width depends on a diameter that nothing varies."""
    stem, [seat] = f"{stem_of(joint)}_{side}", joint.pin.seats
    made = Zone(zone.words, stem, f"joints.{joint.name}.{_SIDES[side]}.deviation", what, zone.zone)
    if what == "tilt":
        length = float(np.ptp(found.face(seat.hole if side == "hole" else seat.pin).extent))
        return replace(made, width=float(f"{2 * zone.zone / length:.6g}"))
    if not zone.maximum_material:
        return made
    diameter = diameters_of(found, joint).get(side)
    if diameter is None:
        return None
    name, share = diameter.parameter, f"{stem}_share"
    bonus = f"{name} - {diameter.lower:.9g}" if side == "hole" else f"{diameter.upper:.9g} - {name}"
    return replace(made, width=2.0, share=share, off=f"{share} * ({zone.zone:.9g} + {bonus}) / 2")


def deviation_of(found: FoundGeometry, joint: FoundJoint, side: str) -> dict[str, Any]:
    """Return the key ``deviation`` of the hole or the pin of a joint; empty if no zone is used."""
    keys: dict[str, Any] = {}
    for zone in _zones_of(found, joint, side).values():
        keys |= {zone.what: zone.off or 0.0, zone.way: 0.0}
    return {"deviation": keys} if keys else {}


def all_zones(found: FoundGeometry) -> list[Zone]:
    """Return the zones of all joints."""
    return [zone for joint in found.joints for side in _SIDES for zone in _zones_of(found, joint, side).values()]


def unused_tolerances(found: FoundGeometry) -> list[str]:
    """Return a line for each limit and zone of the CAD file that nothing in the proposed files follows from."""
    used: set[SizeLimits | GeometricTolerance] = set()
    for joint in found.joints:
        limits = limits_of(found, joint)
        used |= {limits[side] for side in diameters_of(found, joint)}
        used |= {zone for side in _SIDES for zone in _zones_of(found, joint, side)}
    parts = {face.number: face.part for face in found.assembly.faces}
    lines = []
    for limit in found.assembly.limits:
        if limit not in used:
            lines.append(f"{limit.kind} {limit.words}{_on(parts, limit.faces)}")
    for zone in found.assembly.zones:
        if zone not in used:
            lines.append(f"{zone.words}{_on(parts, zone.faces)}")
    return list(dict.fromkeys(lines))


def _on(parts: dict[int, str], faces: Sequence[int]) -> str:
    """Return the parts that a tolerance is on, in words."""
    names = dict.fromkeys(parts[number] for number in faces if number in parts)
    return f" of {' and '.join(names)}" if names else ""
