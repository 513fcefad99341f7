"""Joints: pins in holes and balls in sockets, and near misses, each with the reason; pins that are not drawn.

A pin and its hole are coaxial cylinders of two parts, one inside the other; a ball and its socket concentric spheres. A
slot is two half holes with parallel axes that are open towards each other. A pin that slides in one is a near miss,
although either end of the slot looks like a joint. A pin may not be drawn between coaxial holes of two parts that are
equal in radius, next to each other and with nothing in them.
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

LEAST_SPAN = radians(160.0)  # smallest span of a hole and of a pin [rad]: less than half a turn holds nothing
MOST_CLEARANCE = 0.3  # largest difference of radii [mm] at which a hole still guides a pin of usual size
_OF_LARGE, _OF_SMALL = 0.01, 0.5  # of the radius of a pin: its clearance may be this if it is large, at most if small
MOST_EXCESS = 0.12  # largest offset of the axes beyond the clearance [mm] that a drawn pose may have
_OFF_SMALL = 0.2  # of the radius of a small pin, that its axis may be off at most
_LEAST_SNAP = radians(60.0)
_LOOSEST_SNAP, _SQUEEZED = 0.5, 0.05  # mm by which an open bearing may be wider, or narrower, than its pin
_NEAR = 1.0  # differences of radii and offsets [mm] up to which a refused pair is reported
_PARALLEL = radians(2.0)
_ALIKE = 1e-6  # mm between two radii that count as equal

_ALONG_SLOT = 0.035  # rad between the axes of a slot and of its pin


def _slots(holes: list[CadFace]) -> list[tuple[CadFace, CadFace]]:
    """Return the slots among the hollow cylinders of an assembly: the two round ends of each, faces of one part."""
    halves: dict[str, list[CadFace]] = {}
    for hole in holes:
        if abs(hole.span - pi) < _HALF_TURN:
            halves.setdefault(hole.part, []).append(hole)
    return [ends for alike in halves.values() for ends in combinations(alike, 2) if _are_ends_of_one(*ends)]


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

    hole: int  # number of the face
    pin: int
    hole_radius: Millimetres
    pin_radius: Millimetres
    start: Millimetres  # position along the joint's axis, measured from its point [mm]
    end: Millimetres


@dataclass(frozen=True, eq=False, kw_only=True)
class PinInHole:
    """A joint of two parts: all holes of one around all pins of the other on a common axis."""

    bearing: str  # the part with the hole
    journal: str  # the part with the pin
    point: Coordinates  # on the hole's axis, midway along its seats, shape (3,) [mm]
    axis: Array
    journal_point: Coordinates  # on the pin's axis, at the same position along it, shape (3,) [mm]
    journal_axis: Array  # unit vector, pointing the same way as `axis`
    seats: tuple[Seat, ...]  # ordered along the axis
    radial_clearance: Millimetres  # as drawn, the smallest difference of radii; 0 if both have the same radius
    offset: Millimetres  # largest distance between the two axes along the seats [mm]
    tilt: float  # angle between the two axes [rad]

    overlap: Millimetres  # how far pin and hole overlap as posed [mm]; 0 where the pin lies within its clearance

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
    may_be_one: bool = False  # whether it was refused only by the limits of this module
    snaps: bool = False
    """Whether the hole may be a bearing into which the pin snaps: it fits, but the hole does not close around it."""
    unlikely: int = 0  # rank among the pairs that are not joints: 0 for the most plausible ones


def most_clearance(radius: float) -> float:
    """Return the largest difference of radii at which a hole still guides a pin of a radius [mm]."""
    return min(max(MOST_CLEARANCE, _OF_LARGE * radius), _OF_SMALL * radius)


def most_excess(radius: float) -> float:
    """Return the largest offset of the axes beyond the clearance that a pin of a radius may have as drawn [mm]."""
    return min(MOST_EXCESS, _OFF_SMALL * radius)


@dataclass(frozen=True)
class _Pair:
    """A hole and a pin that are nearly coaxial."""

    hole: CadFace
    pin: CadFace
    start: float  # position along the hole's axis, measured from its point [mm]
    end: float
    offset: float

    @property
    def clearance(self) -> float:
        return self.hole.radius - self.pin.radius

    @property
    def allowed(self) -> float:
        """Largest offset that a drawn pose may have [mm]."""
        return max(self.clearance, 0.0) + most_excess(self.pin.radius)


def pins_in_holes(assembly: CadAssembly) -> tuple[list[PinInHole], list[NearMiss]]:
    """Return the pins in holes of an assembly in mm, in the order of the parts, and the near misses.

    A near miss is a pair whose radii and axes differ by less than 1 mm, but which is neither a joint nor part of one.
    """
    holes, pins = _cylinders(assembly)
    ends = {end.number for slot in _slots(holes) for end in slot}  # a pin is not held there, because it can slide away
    holes = [hole for hole in holes if hole.number not in ends]
    pairs = [(pair, _why_no_pin(pair)) for pair in _near_pairs(holes, pins)]
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
    return [_joint_of_pairs(group) for group in _grouped(accepted)], refused


def _cylinders(assembly: CadAssembly, least_span: float = -1.0) -> tuple[list[CadFace], list[CadFace]]:
    """Return the hollow and the solid cylinders of an assembly that cover more than an angle [rad]."""
    cylinders = [face for face in assembly.faces if face.kind == "cylinder" and face.span > least_span]
    return [face for face in cylinders if face.hollow], [face for face in cylinders if not face.hollow]


def coaxial_fits(assembly: CadAssembly) -> list[tuple[CadFace, CadFace]]:
    """Return the holes and pins of two parts that share a stretch of one axis, whatever their radii.

    Besides joints, these are screws in clearance holes, threads drawn as cylinders, and press fits.
    """
    pairs = [pair for pair in _near_pairs(*_cylinders(assembly, LEAST_SPAN)) if pair.end > pair.start]
    return [(pair.hole, pair.pin) for pair in pairs if pair.offset <= pair.allowed]


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
    start, end = _shared_stretch(hole, pin)
    at = hole.point + np.outer((start, end), hole.axis)
    away = at - pin.point
    away -= np.outer(away @ pin.axis, pin.axis)
    return _Pair(hole, pin, start, end, float(np.linalg.norm(away, axis=1).max()))


def _shared_stretch(first: CadFace, other: CadFace) -> tuple[float, float]:
    """Return where two cylinders lie beside each other, along the axis of the first [mm]; start > end: nowhere."""
    start, end = _stations(other, first)
    return float(max(first.extent[0], start)), float(min(first.extent[1], end))


def _stations(face: CadFace, along: CadFace) -> Array:
    """Return start and end of a cylinder along the axis of another one [mm]."""
    return np.sort((face.point + np.outer(face.extent, face.axis) - along.point) @ along.axis)


def _why_no_pin(pair: _Pair) -> str:
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
    if pair.clearance > (most := most_clearance(pair.pin.radius)) + _ALIKE:
        return f"the radii differ by {pair.clearance:.3g} mm; allowed: up to {most:.3g}"
    if pair.offset > pair.allowed:
        said = f"the axes are {pair.offset:.3g} mm apart; allowed: the clearance + {most_excess(pair.pin.radius):.3g}"
        return f"{said}, so {pair.allowed:.3g}"
    return ""


def _snaps(pair: _Pair) -> bool:
    """Return whether a hole that does not close could hold a pin that is snapped into it."""
    open_hole = _LEAST_SNAP < pair.hole.span <= LEAST_SPAN < pair.pin.span
    fits = -_SQUEEZED <= pair.clearance <= _LOOSEST_SNAP
    return open_hole and fits and pair.end > pair.start and pair.offset <= pair.allowed


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
    is_loose = pair.clearance > max(most_clearance(pair.pin.radius) + _ALIKE, pair.offset)
    return spans > LEAST_SPAN and pair.end > pair.start and is_loose


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
    if (a.hole.part, a.pin.part) != (b.hole.part, b.pin.part):
        return False
    apart, turned = np.linalg.norm(_across(a.hole, b.hole)), abs(a.hole.axis @ b.hole.axis)
    return bool(apart <= most_excess(a.hole.radius) and turned >= np.cos(_PARALLEL))


def _joint_of_pairs(group: list[_Pair]) -> PinInHole:
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
    holes, pins = _cylinders(assembly)
    found = []
    for hole, other in _slots(holes):
        way = _across(hole, other)
        text = (
            f"the hole is a slot, in which the pin slides {np.linalg.norm(way):.4g} mm; write contacts of the pin"
            " with its flat sides and, where it gets there, its ends"
        )
        sliding = [pin for pin in pins if _slides(hole, pin, way)]
        found += [NearMiss(hole=hole.number, pin=pin.number, reason=text) for pin in sliding]
    return found


def _slides(hole: CadFace, pin: CadFace, way: Array) -> bool:
    """Return whether a pin of another part is as thick as a slot is wide, parallel to it, next to it and in it.

    `hole` is one end of the slot, `way` the vector to the axis of the other one, shape (3,) [mm].
    """
    clearance, (start, end) = hole.radius - pin.radius, _shared_stretch(hole, pin)
    if pin.part == hole.part or not -_ALIKE <= clearance <= most_clearance(pin.radius) or end <= start:
        return False
    away = _across(hole, pin)
    off = np.linalg.norm(away - np.clip(away @ way / (way @ way), 0.0, 1.0) * way)
    return bool(
        abs(hole.axis @ pin.axis) >= np.cos(_ALONG_SLOT) and off <= max(clearance, 0.0) + most_excess(pin.radius)
    )


# -- balls in sockets -------------------------------------------------------------------------------------------------

_LEAST_BALL = 0.25  # share of a whole sphere; less is a rounded end
_DIRECTIONS = 4000  # number of directions in which a ball could leave its socket


@dataclass(frozen=True, eq=False, kw_only=True)
class BallInSocket:
    """A joint of two parts: a ball held by its socket in all directions."""

    socket_part: str
    ball_part: str
    socket: int  # number of the face
    ball: int
    centre: Coordinates  # centre of the socket, shape (3,) [mm]
    ball_centre: Coordinates
    socket_radius: Millimetres
    ball_radius: Millimetres
    radial_clearance: Millimetres  # as drawn; 0 if both have the same radius
    overlap: Millimetres  # how far ball and socket overlap as posed [mm]


def balls_in_sockets(assembly: CadAssembly, triangles: dict[int, Array]) -> tuple[list[BallInSocket], list[NearMiss]]:
    """Return the balls in sockets of an assembly in mm, and the near misses; triangles from `triangles_by_face`."""
    spheres = [face for face in assembly.faces if face.kind == "sphere" and face.number in triangles]
    found, refused = [], []
    for socket in (face for face in spheres if face.hollow):
        for ball in (face for face in spheres if not face.hollow and face.part != socket.part):
            whole = ball.area > _LEAST_BALL * 4 * np.pi * ball.radius**2
            if not whole or abs(socket.radius - ball.radius) > _NEAR or _offset(socket, ball) > _NEAR:
                continue
            if reason := _why_no_ball(socket, ball, triangles[socket.number].reshape(-1, 3)):
                refused.append(NearMiss(hole=socket.number, pin=ball.number, reason=reason))
            else:
                found.append(_joint_of_ball(socket, ball))
    return found, refused


def _offset(socket: CadFace, ball: CadFace) -> float:
    return float(np.linalg.norm(ball.point - socket.point))


def _unsure(socket: CadFace, ball: CadFace) -> float:
    """Return the difference of the radii [mm] that is not significant."""
    return socket.recognition_gap + ball.recognition_gap + 1e-9


def _why_no_ball(socket: CadFace, ball: CadFace, points: Array) -> str:
    """Return why a pair is not a joint; empty if it is one."""
    clearance, far = socket.radius - ball.radius, _offset(socket, ball)
    if clearance < -_unsure(socket, ball) - 1e-6:
        return f"the ball is {-clearance:.3g} mm larger in radius than the socket: a press fit, or an error"
    if clearance > (most := most_clearance(ball.radius)) + _ALIKE:
        return f"the radii differ by {clearance:.3g} mm; allowed: up to {most:.3g}"
    allowed = max(clearance, 0.0) + (excess := most_excess(ball.radius))
    if far > allowed:
        return f"the centres are {far:.3g} mm apart; allowed: the clearance + {excess:.3g}, so {allowed:.3g}"
    if not _holds(points - socket.point, ball.radius):
        return "the ball can leave the socket, which is not all round it; write a contact of a sphere and a socket"
    return ""


def _holds(points: Array, ball_radius: float) -> bool:
    """Return whether a socket, given by points relative to its centre, is narrower than the ball in all directions."""
    away = np.linalg.norm(points, axis=1)
    towards = points / away[:, None]
    turns = np.arange(_DIRECTIONS) * np.pi * (3.0 - np.sqrt(5.0))  # an evenly spaced spiral of points
    heights = 1.0 - (2.0 * np.arange(_DIRECTIONS) + 1.0) / _DIRECTIONS
    across = np.sqrt(1.0 - heights**2)
    ways = np.column_stack([across * np.cos(turns), across * np.sin(turns), heights])
    beyond = max(0.0, 1.0 - (ball_radius / float(away.max())) ** 2) ** 0.5  # sine of the angle past the widest circle
    return bool((ways @ towards.T).max(axis=1).min() > max(beyond, 0.02))


def _joint_of_ball(socket: CadFace, ball: CadFace) -> BallInSocket:
    clearance, unsure = socket.radius - ball.radius, _unsure(socket, ball)
    overlap = _offset(socket, ball) - max(clearance, 0.0)
    return BallInSocket(
        socket_part=socket.part,
        ball_part=ball.part,
        socket=socket.number,
        ball=ball.number,
        centre=socket.point,
        ball_centre=ball.point,
        socket_radius=socket.radius,
        ball_radius=ball.radius,
        radial_clearance=clearance if clearance > unsure else 0.0,
        overlap=overlap if overlap > unsure else 0.0,
    )


# -- pins that are not drawn ------------------------------------------------------------------------------------------

_MOST_DIFFERENCE = 0.3  # mm between the radii of two holes for one pin
_MOST_APART = 1.0  # mm between the holes along their axis
_THINNEST = 0.5  # of the radius of a hole, for what counts as something in it
_COAXIAL = 1e-3  # rad


@dataclass(frozen=True, eq=False, kw_only=True)
class UndrawnPin:
    """Two holes in which a pin or a screw may be missing."""

    holes: tuple[int, int]  # numbers of the faces
    parts: tuple[str, str]
    radii: tuple[float, float]
    point: Coordinates  # on the axis of the first hole, midway along it, shape (3,) [mm]
    axis: Array
    half_length: Millimetres  # half the length of the first hole


def undrawn_pins(assembly: CadAssembly) -> list[UndrawnPin]:
    """Return the pins that may be missing in an assembly in mm: one for each two parts and axis, in their order."""
    holes, pins = _cylinders(assembly, LEAST_SPAN)
    empty = [hole for hole in holes if not any(_is_in(pin, hole) for pin in _coaxial(pins, hole))]
    found: list[UndrawnPin] = []
    for first in empty:
        for second in _coaxial(empty, first):
            if first.number >= second.number or first.part == second.part:
                continue
            if not _are_for_one_pin(first, second) or any(_is_known(first, second, each) for each in found):
                continue
            found.append(
                UndrawnPin(
                    holes=(first.number, second.number),
                    parts=(first.part, second.part),
                    radii=(first.radius, second.radius),
                    point=first.point + float(np.mean(first.extent)) * first.axis,
                    axis=first.axis,
                    half_length=float(np.ptp(first.extent)) / 2,
                )
            )
    return found


def _coaxial(faces: list[CadFace], about: CadFace) -> list[CadFace]:
    """Return the cylinders that are coaxial with another one."""
    if not faces:
        return []
    away = np.array([face.point for face in faces]) - about.point
    far = np.linalg.norm(np.cross(away, about.axis), axis=1)
    turned = np.abs(np.array([face.axis for face in faces]) @ about.axis)
    return [faces[i] for i in np.flatnonzero((far <= MOST_EXCESS) & (turned > np.cos(_COAXIAL)))]


def _is_in(pin: CadFace, hole: CadFace) -> bool:
    """Return whether a pin, which is coaxial with a hole, is in it."""
    start, end = _shared_stretch(hole, pin)
    return end > start and _THINNEST * hole.radius <= pin.radius <= hole.radius + _MOST_DIFFERENCE


def _are_for_one_pin(first: CadFace, second: CadFace) -> bool:
    """Return whether coaxial holes are equal and next to each other."""
    start, end = _stations(second, first)
    apart = max(start - first.extent[1], first.extent[0] - end)
    return bool(abs(first.radius - second.radius) <= _MOST_DIFFERENCE and -MOST_EXCESS <= apart <= _MOST_APART)


def _is_known(first: CadFace, second: CadFace, known: UndrawnPin) -> bool:
    """Return whether a pin between the same parts on the same axis has been found."""
    far = np.linalg.norm(np.cross(known.point - first.point, first.axis))
    return {first.part, second.part} == set(known.parts) and bool(far <= MOST_EXCESS)
