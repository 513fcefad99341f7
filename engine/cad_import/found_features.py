"""The features found in a CAD file with their places: parts, joints, candidates for stops, pins that are not joints."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees
from typing import Literal

import numpy as np

from engine.arrays import Array
from engine.cad.cad_model import CadFace, CadPart
from engine.cad.findings.facing_planes import FacingPlanes
from engine.cad.findings.joints import NearMiss, UndrawnPin
from engine.cad_import.drawn_tolerances import unused_tolerances
from engine.cad_import.found_geometry import FoundBall, FoundGeometry, FoundJoint, FoundPivot, FoundSpring, FoundStop
from engine.cad_import.proposed_groups import PartGroup
from engine.cad_import.proposed_joints import least_clearance, side
from engine.cad_import.proposed_text import value

MOST_LISTED = 10  # pairs that are no joints, and candidates for stops, that are described one by one


@dataclass(frozen=True, eq=False, kw_only=True)
class FoundFeature:
    """A feature found between two parts; lengths in mm, in the frame of the assembly."""

    kind: Literal["joint", "no joint", "facing"]
    name: str  # in the proposed mechanism file: ``base-crank``, ``stop-1``; its number if it is not a joint
    parts: tuple[str, str]
    faces: tuple[int, ...]  # numbers; for a joint those of holes and pins, without flanges
    between: str  # the parts, in words
    sizes: str  # size of the gap or clearance, in words, or why it is not a joint
    ends: Array  # shape (2, 3): ends of a joint on its axis; centre of a ball, twice; a point of each face of a stop
    radii: str = ""  # of hole and pin, or of socket and ball, in words; empty if it is not a joint
    radius: float = 0.0  # of the hole or the socket; 0 for a stop

    @property
    def said(self) -> str:
        """The description without the name."""
        return ", ".join(filter(None, (self.between, self.radii, self.sizes)))

    @property
    def text(self) -> str:
        """The full description."""
        return f"{self.kind} {self.name}: {self.said}"

    @property
    def middle(self) -> Array:
        """The midpoint of the ends, shape (3,)."""
        return np.asarray(self.ends.mean(axis=0))


def part_text(part: CadPart) -> str:
    """Return the description of a part."""
    volume = sum(solid.volume for solid in part.solids)
    return f"part {part.name}: {volume:.6g} mm3, {part.material.name if part.material else 'no material'}"


def standard_texts(found: FoundGeometry) -> list[str]:
    """Return a line for each kind of parts that are bought: how many of which product."""
    lines = []
    for kind in dict.fromkeys(each.kind for each in found.standard):
        parts = [(each, found.drawn.part(each.part)) for each in found.standard if each.kind == kind]
        counts = Counter(f"{part.product or part.name} ({each.said})" for each, part in parts)
        listed = ", ".join(f"{count} {name}" if count > 1 else name for name, count in counts.items())
        lines.append(f"{len(parts)} {kind}{'s' if len(parts) > 1 else ''}: {listed}")
    return lines


def folded_features(found: FoundGeometry, features: Sequence[FoundFeature]) -> list[str]:
    """Return the descriptions of features: all joints, and of the others the most plausible, alike ones in one line."""
    lines = [each.text for each in features if each.kind == "joint"]
    refused = [each for each in features if each.kind == "no joint"]
    counts = Counter((each.between, each.sizes) for each in refused)
    alike = [next(each for each in refused if (each.between, each.sizes) == key) for key in counts]
    lines += [f"{each.text}{_times(counts[each.between, each.sizes])}" for each in alike[:MOST_LISTED]]
    if len(alike) > MOST_LISTED:
        left = len(refused) - sum(counts[each.between, each.sizes] for each in alike[:MOST_LISTED])
        lines.append(f"no joint: {left} more pins and holes, less likely ones; --json lists all")
    order = {stop.name: _unlikely(stop) for stop in found.stops}
    facing = sorted((each for each in features if each.kind == "facing"), key=lambda each: order[each.name])
    lines += [each.text for each in facing[:MOST_LISTED]]
    if len(facing) > MOST_LISTED:
        lines.append(f"facing: {len(facing) - MOST_LISTED} more, less likely ones; the mechanism file lists all")
    return lines


def folded_tolerances(found: FoundGeometry) -> list[str]:
    """Return lines about the limits and zones of the CAD file that nothing proposed follows from."""
    unused = unused_tolerances(found)
    lines = [f"not used: {each}" for each in unused[:MOST_LISTED]]
    if len(unused) > MOST_LISTED:
        lines.append(f"not used: {len(unused) - MOST_LISTED} more tolerances; --json lists all")
    return lines


def _unlikely(stop: FoundStop) -> tuple[float, float]:
    """Return a rank of a candidate for a stop: the nearest come first, and among equally near ones the largest."""
    size = stop.pair.area if isinstance(stop.pair, FacingPlanes) else stop.pair.length
    return round(max(stop.pair.gap, 0.0), 2), -size


def _times(count: int) -> str:
    return f" ({count} times)" if count > 1 else ""


def pivot_text(found: FoundGeometry, pivot: FoundPivot) -> str:
    """Return the description of a joint that may be there."""
    if isinstance(pivot.pin, UndrawnPin):
        first, second = pivot.pin.parts
        radii = " and ".join(f"{radius:.6g}" for radius in pivot.pin.radii)
        return f"undrawn pin {pivot.name}: coaxial holes of {first} and {second}, radii {radii}, and nothing in them"
    hole, pin = found.face(pivot.pin.hole), found.face(pivot.pin.pin)
    sizes = f"radii {hole.radius:.6g} and {pin.radius:.6g}, {degrees(hole.span):.0f} degrees of the hole are there"
    return f"snap-in {pivot.name}: pin of {pin.part} in {hole.part}, {sizes}"


def spring_text(spring: FoundSpring) -> str:
    """Return the description of a spring."""
    ends = " and ".join(filter(None, spring.ends)) or "nothing that it touches"
    return f"spring {spring.name}: between {ends}"


def group_text(found: FoundGeometry, group: PartGroup) -> str:
    """Return the description of a group of parts."""
    return f"group {found.bodies[group.name]}: {', '.join(group.parts)}{f' ({group.why})' if group.why else ''}"


def found_features(found: FoundGeometry) -> list[FoundFeature]:
    """Return all features found: joints, then pairs that are not joints, then candidates for stops, each in order."""
    faces = {face.number: face for face in found.assembly.faces}
    joints = [*map(_joint, found.joints), *map(_ball, found.balls)]
    refused = [_no_joint(found, miss, number, faces) for number, miss in enumerate(found.refused, 1)]
    return [*joints, *refused, *map(_stop, found.stops)]


def _joint(joint: FoundJoint) -> FoundFeature:
    pin, first = joint.pin, joint.pin.seats[0]
    plays = ", ".join(f"{round(flange.play, 9) + 0.0:.4g}" for flange in joint.flanges)  # avoids -0
    axial = f", axial play {plays} mm" if plays else " mm, free along its axis"
    radii = [f"{seat.hole_radius:.6g} and {seat.pin_radius:.6g}" for seat in pin.seats]
    least = least_clearance(pin)
    return FoundFeature(
        kind="joint",
        name=joint.name,
        parts=(pin.journal, pin.bearing),
        faces=tuple(dict.fromkeys(number for seat in pin.seats for number in (seat.hole, seat.pin))),
        between=f"{pin.journal} in {pin.bearing}",
        radii=f"radii {', '.join(dict.fromkeys(radii))}",
        sizes=f"clearance {pin.radial_clearance:.4g}{f' ({least})' if least else ''}{axial}",
        ends=pin.point + np.outer((first.start, pin.seats[-1].end), pin.axis),
        radius=first.hole_radius,
    )


def _ball(found: FoundBall) -> FoundFeature:
    ball = found.ball
    return FoundFeature(
        kind="joint",
        name=found.name,
        parts=(ball.ball_part, ball.socket_part),
        faces=(ball.socket, ball.ball),
        between=f"ball of {ball.ball_part} in {ball.socket_part}",
        radii=f"radii {ball.socket_radius:.6g} and {ball.ball_radius:.6g}",
        sizes=f"clearance {ball.radial_clearance:.4g} mm",
        ends=np.array([ball.centre, ball.centre]),
        radius=ball.socket_radius,
    )


def _no_joint(found: FoundGeometry, miss: NearMiss, number: int, faces: dict[int, CadFace]) -> FoundFeature:
    hole, pin = faces[miss.hole], faces[miss.pin]
    written = f"bearing = {value(side(found, hole))}, journal = {value(side(found, pin))}"
    otherwise = f"; if it is a joint, write one with {written}" if miss.may_be_one else ""
    return FoundFeature(
        kind="no joint",
        name=str(number),
        parts=(pin.part, hole.part),
        faces=(miss.hole, miss.pin),
        between=f"{'ball' if pin.kind == 'sphere' else 'pin'} of {pin.part} in {hole.part}",
        sizes=f"{miss.reason}{otherwise}",
        ends=hole.point + np.outer(hole.extent, hole.axis),
        radius=hole.radius,
    )


def _stop(stop: FoundStop) -> FoundFeature:
    pair = stop.pair
    return FoundFeature(
        kind="facing",
        name=stop.name,
        parts=pair.parts,
        faces=pair.faces,
        between=" and ".join(pair.parts),
        sizes=stop.sizes,
        ends=np.array([pair.middle, pair.middle + pair.gap * pair.normal]),
    )
