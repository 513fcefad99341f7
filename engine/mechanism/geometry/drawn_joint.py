"""A pin in a hole as drawn: the position, length and play of the joint."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from engine.arrays import Array
from engine.cad import CadFace
from engine.mechanism.geometry.cad_table import AS_DRAWN
from engine.mechanism.geometry.face_search import PartSearch, axis_of, length, line_side
from engine.mechanism.geometry.geometry_certificate import DrawnJoint

NO_PLAY = 1e-9
"""Clearance [mm] below which a pin and its hole count as drawn with equal radii, beyond the recognition gap of their
faces.
"""


class NotAsDrawn(Exception):
    """The CAD file does not provide what a joint requires; the message says why, ``key`` for which key."""

    def __init__(self, key: str, text: str) -> None:
        super().__init__(text)
        self.key = key


@dataclass(frozen=True, eq=False)
class DrawnPin:
    """A pin in a hole at the start pose of the CAD file, in the mechanism's unit of length and the assembly's frame."""

    hole: CadFace
    pin: CadFace

    @cached_property
    def axis(self) -> Array:
        """The direction of the hole's axis."""
        return axis_of(self.hole)

    @cached_property
    def common(self) -> tuple[float, float]:
        """Start and end of the overlap of hole and pin along the hole's axis, measured from the hole's middle."""
        own = sorted(self.hole.extent * float(self.hole.axis @ self.axis))
        ends = [float((self.pin.point + end * self.pin.axis - self.hole.point) @ self.axis) for end in self.pin.extent]
        return max(own[0], min(ends)), min(own[1], max(ends))

    @property
    def middle(self) -> Array:
        """The point of the hole's axis in the middle of the overlap."""
        return np.asarray(self.hole.point + sum(self.common) / 2 * self.axis)

    @property
    def pin_axis(self) -> Array:
        """The direction of the pin's axis, with the sign that agrees with the hole's axis."""
        return self.pin.axis if self.pin.axis @ self.axis > 0 else -self.pin.axis

    @property
    def pin_middle(self) -> Array:
        """The point of the pin's axis at the middle of the overlap."""
        along = float((self.middle - self.pin.point) @ self.axis) / float(self.pin_axis @ self.axis)
        return np.asarray(self.pin.point + along * self.pin_axis)

    def certificate(self) -> DrawnJoint:
        """Return the clearance, and the distance and the angle between the axes."""
        tilt = float(np.arctan2(np.linalg.norm(np.cross(self.axis, self.pin_axis)), self.axis @ self.pin_axis))
        offset = float(np.linalg.norm(self.pin_middle - self.middle))
        return DrawnJoint(
            clearance=round(self.hole.radius - self.pin.radius, 15),
            axis_offset=offset,
            tilt=tilt,
            length=self.common[1] - self.common[0],
        )


def joint_of_pin(drawn: DrawnPin, joint: Mapping[str, Any], searches: tuple[PartSearch, PartSearch]) -> dict[str, Any]:
    """Return the table of a joint with a hole as its bearing and a pin as its journal, from that without selectors.

    The rings are at both ends of the overlap unless the table gives others; `AS_DRAWN` is replaced by a number. Raise
    NotAsDrawn if pin and hole do not overlap along the axis, or have no play although it is requested as drawn.
    """
    begin, end = drawn.common
    if end <= begin:
        raise NotAsDrawn(
            "journal.pin",
            f"pin and hole lie {begin - end:.4g} apart along the axis of the hole; allowed: a pin in its hole; "
            "name other faces, or correct the assembly in the CAD file",
        )
    if abs(float(drawn.pin_axis @ drawn.axis)) < 0.5:
        raise NotAsDrawn(
            "journal.pin", "the axes of pin and hole cross; allowed: nearly parallel axes; name other faces"
        )
    millimetre = searches[0].millimetre
    offset = drawn.certificate().axis_offset
    if offset >= drawn.hole.radius:
        raise NotAsDrawn(
            "journal.pin",
            f"its axis is {offset:.4g} from that of the hole; allowed: less than the hole's radius "
            f"{drawn.hole.radius:.4g}; name other faces, or correct the assembly in the CAD file",
        )
    half = length((end - begin) / 2, millimetre)
    result = {"rings": [-half, half], **joint}
    if joint.get("rings") == AS_DRAWN:
        result["rings"] = [-half, half]
    if joint.get("radial_clearance") == AS_DRAWN:
        result["radial_clearance"] = _clearance(drawn, millimetre)
    result["bearing"] = line_side(searches[0], joint["bearing"], drawn.middle, drawn.axis)
    journal = {"radius": length(drawn.pin.radius, millimetre), **joint["journal"]}
    result["journal"] = line_side(searches[1], journal, drawn.pin_middle, drawn.pin_axis)
    return result


def _clearance(drawn: DrawnPin, millimetre: float) -> float:
    """Return the difference between the radii; refuse a pair that has none."""
    clearance = drawn.hole.radius - drawn.pin.radius
    unsure = NO_PLAY * millimetre + drawn.hole.recognition_gap + drawn.pin.recognition_gap
    if clearance > unsure:
        return length(clearance, millimetre)
    what = "no play" if abs(clearance) <= unsure else "a pin that is larger than its hole"
    raise NotAsDrawn(
        "radial_clearance",
        f"drawn with {what}: the hole has radius {drawn.hole.radius:.9g}, the pin {drawn.pin.radius:.9g}; "
        "allowed: a number > 0; write the clearance, as the tolerances of the two give it",
    )
