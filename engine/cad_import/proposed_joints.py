"""The tables of joints and contacts: pins in holes, with rings, clearance and flanges; balls in sockets; stops, marked.

A stop or a latch may be where two faces face each other; only a person knows, so its table is marked as inactive.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from math import degrees, radians
from typing import Any

import numpy as np

from engine.arrays import Array
from engine.cad.cad_model import CadFace
from engine.cad.findings.facing_planes import FacingPlanes
from engine.cad.findings.facing_rounds import WHOLE, ExtrudedProfile, FacingRound
from engine.cad.findings.joints import NearMiss, PinInHole, UndrawnPin
from engine.cad_import.drawn_tolerances import deviation_of, diameters_of, limits_of
from engine.cad_import.found_geometry import FoundBall, FoundGeometry, FoundJoint, FoundStop
from engine.cad_import.proposed_text import key_line, marked, question, value
from engine.errors import some
from engine.mechanism.geometry.cad_table import AS_DRAWN, NearPlace, RoundFace
from engine.mechanism.geometry.drawn_features import NotOneFace, PartSearch, axis_of

LAW = "contact"  # the material pair of all proposed joints and contacts

RADIAL_PLAY, AXIAL_PLAY = "radial_play", "axial_play"  # parameters for the plays of joints that are drawn without any

_NEARER = None, 0.1, 0.01, 1e-3  # mm of a point from its face: half a millimetre, or less if others are as near
_FEW = 2  # joints that are asked about one by one
_PIN_PLAY = 0.02  # mm, of a pin that is not drawn
_ALIKE = 1e-6  # mm
_LEAST_PLAY = 1e-6  # mm
_OPEN = radians(190.0)  # a pin can leave a hole with a smaller span


@dataclass(frozen=True)
class SharedQuestions:
    """What the CAD file does not say of many joints, so that it is asked once for all of them: names of joints."""

    radial: tuple[str, ...]  # drawn without radial clearance
    axial: tuple[str, ...]  # drawn without axial play
    free: tuple[str, ...]  # that nothing holds along their axes


def shared_questions(found: FoundGeometry) -> SharedQuestions:
    """Return the questions that are asked once, because they are about three or more joints."""
    drawn_without = [joint for joint in found.joints if joint.pin.radial_clearance <= 0]
    radial = [joint.name for joint in drawn_without if not limits_of(found, joint)]
    radial += [joint.name for joint in found.balls if joint.ball.radial_clearance <= 0]
    axial = [joint.name for joint in found.joints if joint.flanges and _play(joint) <= _LEAST_PLAY]
    free = [joint.name for joint in found.joints if not joint.flanges]
    return SharedQuestions(*(tuple(each) if len(each) > _FEW else () for each in (radial, axial, free)))


def play_parameters(shared: SharedQuestions) -> list[str]:
    """Return the parameters for plays that are not drawn, marked, below their question."""
    lines, texts = [], []
    if shared.radial:
        texts.append(f"radial clearance of {some(shared.radial)}")
        lines.append(key_line(RADIAL_PLAY, 0.02, "mm"))
    if shared.axial:
        texts.append(f"axial play at each end of {some(shared.axial)}")
        lines.append(key_line(AXIAL_PLAY, 0.05, "mm"))
    if not texts:
        return []
    text = f"which {' and '.join(texts)} do the tolerances leave? They are drawn without; a joint may have another one"
    return [question("parameters", text), *marked(lines)]


def free_joints(shared: SharedQuestions) -> list[str]:
    """Return the question about joints that nothing holds along their axes."""
    if not shared.free:
        return []
    text = (
        f"nothing was found that holds {some(shared.free)} along their axes; if something does, make them"
        " clearance_revolute with flanges and axial_clearance"
    )
    return [question("joints", text), ""]


def pivot_tables(found: FoundGeometry) -> list[str]:
    """Return the joints that may be there, marked: pins that are not drawn, and bearings into which pins snap."""
    undrawn = [(each.name, each.pin) for each in found.pivots if isinstance(each.pin, UndrawnPin)]
    snaps = [(each.name, each.pin) for each in found.pivots if isinstance(each.pin, NearMiss)]
    lines = []
    if undrawn:
        text = "which of these equal holes get a pin or a screw that is not drawn? Remove the marks of those"
        lines.append(question("joints", f"{text}, and correct the radius of the pin"))
        for name, pin in undrawn:
            lines += [*_marked_table(name, _undrawn_lines(found, pin)), ""]
    if snaps:
        text = "does the pin snap into one of these holes, which do not close around it? Remove the marks of those"
        lines.append(question("joints", text))
        for name, miss in snaps:
            hole, pin_face = found.face(miss.hole), found.face(miss.pin)
            play = AS_DRAWN if hole.radius - pin_face.radius > _LEAST_PLAY else 0.02
            table = [
                key_line("bearing", side(found, hole)),
                key_line("journal", side(found, pin_face)),
                key_line("radial_clearance", play, f"{degrees(hole.span):.0f} degrees of the hole are there"),
            ]
            lines += [*_marked_table(name, table), ""]
    return lines


def _marked_table(name: str, lines: list[str]) -> list[str]:
    return marked([f"[joints.{name}]", 'type = "clearance_cylindrical"', *lines, key_line("material", LAW)])


def _undrawn_lines(found: FoundGeometry, pin: UndrawnPin) -> list[str]:
    """Return the keys of a joint whose pin is not drawn: the pin belongs to the second part."""
    hole, other = (found.face(number) for number in pin.holes)
    turn = found.assembly.part(other.part).placement.rotation
    journal = {
        "body": found.bodies[other.part],
        "point": np.round(found.to_body(other.part, pin.point), 6) + 0.0,
        "axis": np.round(turn.T @ axis_of(hole), 12) + 0.0,
        "radius": round(min(pin.radii) - _PIN_PLAY, 9),
    }
    return [
        key_line("bearing", side(found, hole)),
        key_line("journal", journal),
        key_line("rings", [-round(pin.half_length, 6), round(pin.half_length, 6)]),
        key_line("radial_clearance", round(pin.radii[0] - min(pin.radii) + _PIN_PLAY, 9), "to be corrected"),
    ]


def _play(joint: FoundJoint) -> float:
    return float(np.mean([flange.play for flange in joint.flanges]))


def joint_lines(found: FoundGeometry, joint: FoundJoint, shared: SharedQuestions) -> list[str]:
    """Return the table of a joint, with a question for everything that the CAD file does not provide."""
    pin = joint.pin
    first = pin.seats[0]
    holes, pins = [found.face(seat.hole) for seat in pin.seats], [found.face(seat.pin) for seat in pin.seats]
    stations = _Stations(joint, axis_of(holes[0]))
    shaft = side(found, pins[0])
    lines = [
        f"[joints.{joint.name}]",
        f'type = "clearance_{"revolute" if joint.flanges else "cylindrical"}"',
        key_line("bearing", side(found, holes[0]) | deviation_of(found, joint, "hole")),
    ]
    radii = [seat.pin_radius for _, seat in pin.rings]
    stepped = np.ptp(radii) > _ALIKE
    if stepped:
        shaft["radius"] = radii if stations.sign > 0 else radii[::-1]
    if (shift := stations.shift()) is not None:
        shaft["point"] = found.to_body(pin.journal, shift)
    lines.append(key_line("journal", shaft | deviation_of(found, joint, "pin")))
    if len(pin.seats) > 1:
        lines.append(key_line("rings", sorted(round(stations.of(station), 9) for station, _ in pin.rings)))
    in_numbers = stepped or first.hole_radius - first.pin_radius != pin.radial_clearance
    if joint.name in shared.radial:
        lines.append(key_line("radial_clearance", RADIAL_PLAY, f"both drawn with radius {first.pin_radius:.6g} mm"))
    else:
        lines += _clearance_lines(found, joint, in_numbers)
    lines += _flange_lines(joint, stations, shared)
    if (span := min(face.span for face in holes)) < _OPEN:
        text = f"only {degrees(span):.0f} degrees of the hole are there; a joint holds its pin all round;"
        lines.append(question(f"joints.{joint.name}", f"{text} if this one can leave, write contacts in its place"))
    if pin.overlap > 0:
        lines.append(_overlap_question(joint.name, "pin and hole", pin.overlap))
    return [*lines, key_line("material", LAW), ""]


def ball_lines(found: FoundGeometry, joint: FoundBall, shared: SharedQuestions) -> list[str]:
    """Return the table of a ball in its socket in numbers, with a question for what the CAD file does not provide."""
    ball = joint.ball
    socket = {"body": found.bodies[ball.socket_part], "point": found.to_body(ball.socket_part, ball.centre).round(9)}
    centre = found.to_body(ball.ball_part, ball.ball_centre).round(9)
    inner = {"body": found.bodies[ball.ball_part], "point": centre, "radius": round(ball.ball_radius, 9)}
    lines = [
        f"[joints.{joint.name}]",
        'type = "clearance_spherical"',
        key_line("socket", socket),
        key_line("ball", inner),
    ]
    if ball.radial_clearance > 0:
        lines.append(key_line("radial_clearance", round(ball.radial_clearance, 9)))
    elif joint.name in shared.radial:
        lines.append(key_line("radial_clearance", RADIAL_PLAY, f"both drawn with radius {ball.ball_radius:.6g} mm"))
    else:
        lines += _asked_clearance(joint.name, "ball and socket", ball.ball_radius)
    if ball.overlap > 0:
        lines.append(_overlap_question(joint.name, "ball and socket", ball.overlap))
    return [*lines, key_line("material", LAW), ""]


def _pressed_in(found: FoundGeometry, joint: FoundJoint) -> str:
    """Return what to write if a pin cannot move in its hole."""
    pin = joint.pin
    sides = [
        f"{side} = {value({'body': found.bodies[part], 'point': found.to_body(part, pin.point).round(9)})}"
        for side, part in (("a", pin.bearing), ("b", pin.journal))
    ]
    return f' If the pin is pressed in, the joint is type = "fixed", {" and ".join(sides)}, and nothing else'


def _asked_clearance(name: str, sides: str, radius: float, otherwise: str = "") -> list[str]:
    """Return the question about a clearance that is not drawn."""
    text = f"{sides} are both drawn with radius {radius:.6g} mm; which clearance do their tolerances leave?{otherwise}"
    return [question(f"joints.{name}.radial_clearance", text), "# radial_clearance = 0.02"]


def _overlap_question(name: str, sides: str, overlap: float) -> str:
    text = f"{sides} overlap by {overlap:.4g} mm as posed; correct the assembly, or give origin of a body"
    return question(f"joints.{name}", text)


@dataclass(frozen=True, eq=False)
class _Stations:
    """Stations along a joint's axis as counted in the mechanism file: from the middle of its first seat."""

    joint: FoundJoint
    axis: Array  # direction in which the file counts: the joint's axis or its opposite

    @property
    def sign(self) -> float:
        return float(np.sign(self.axis @ self.joint.pin.axis))

    def of(self, station: float) -> float:
        """Return a station, given from the joint's point, as counted in the file."""
        first = self.joint.pin.seats[0]
        return self.sign * (station - (first.start + first.end) / 2)

    def shift(self) -> Array | None:
        """Return the point of the pin that is in the middle when the pin is; None if it stays as posed."""
        plays = {flange.side: flange.play for flange in self.joint.flanges}
        if len(plays) < 2 or abs(plays["end"] - plays["start"]) < _ALIKE:
            return None
        pin = self.joint.pin
        first = pin.seats[0]
        middle = (first.start + first.end) / 2 + (plays["end"] - plays["start"]) / 2
        return np.asarray(pin.journal_point + middle * pin.journal_axis)


def side(found: FoundGeometry, face: CadFace) -> dict[str, Any]:
    """Return the side of a joint on a hole or a pin."""
    return {"body": found.bodies[face.part], "hole" if face.hollow else "pin": _selector(found, face)}


def _selector(found: FoundGeometry, face: CadFace) -> dict[str, Any]:
    """Return what selects a hole or a pin; in a body of several parts, such that no other face fits."""
    near = np.round(found.to_body(face.part, face.point), 6)
    wanted: dict[str, Any] = {"radius": round(face.radius, 9), "near": near}
    if all(group.name != face.part for group in found.groups):
        return wanted
    search = partial(PartSearch(found.assembly, face.part, 1.0).round_face, hollow=face.hollow)
    return _selects_one(wanted, lambda table: search(RoundFace.model_validate(table))) or wanted


def _selects_one(wanted: dict[str, Any], search: Callable[[dict[str, Any]], object]) -> dict[str, Any] | None:
    """Return what selects a single face near a point, as close to it as needed; None if others are always as near."""
    for within in _NEARER:
        closer = wanted if within is None else {**wanted, "within": within}
        with suppress(NotOneFace):
            search({**closer, "near": wanted["near"].tolist()})
            return closer
    return None


def _clearance_lines(found: FoundGeometry, joint: FoundJoint, in_numbers: bool) -> list[str]:
    """Return the radial clearance: from limits, as drawn, or as a question."""
    clearance, key = joint.pin.radial_clearance, "radial_clearance"
    if diameters := diameters_of(found, joint):
        [seat] = joint.pin.seats
        hole = diameters["hole"].parameter if "hole" in diameters else f"{2 * seat.hole_radius:.9g}"
        pin = diameters["pin"].parameter if "pin" in diameters else f"{2 * seat.pin_radius:.9g}"
        drawn = f"{clearance:.6g} as drawn" if clearance > 0 else "drawn without"
        return [key_line(key, f"({hole} - {pin}) / 2", drawn)]
    if clearance <= 0:
        radius = joint.pin.seats[0].pin_radius
        known = " and ".join(f"{side} {limits.words}" for side, limits in limits_of(found, joint).items())
        stated = f" The CAD file has {known}." if known else ""
        return _asked_clearance(joint.name, "pin and hole", radius, stated + _pressed_in(found, joint))
    text = least_clearance(joint.pin) or f"{clearance:.6g}"
    return [key_line(key, clearance if in_numbers else AS_DRAWN, text)]


def least_clearance(pin: PinInHole) -> str:
    """Return the radial clearances of which that of a joint is the smallest; empty if all are equal."""
    drawn = list(dict.fromkeys(f"{seat.hole_radius - seat.pin_radius:.4g}" for seat in pin.seats))
    return f"the least of {', '.join(drawn[:-1])} and {drawn[-1]}, for all rings" if len(drawn) > 1 else ""


def _flange_lines(joint: FoundJoint, stations: _Stations, shared: SharedQuestions) -> list[str]:
    """Return the flanges and the axial clearance."""
    if joint.name in shared.free:
        return []
    if not joint.flanges:
        text = "nothing was found that holds it along its axis; if something does, make it a clearance_revolute"
        return [question(f"joints.{joint.name}", f"{text} with flanges and axial_clearance")]
    faces = {flange.side: flange for flange in joint.flanges}
    pin = joint.pin
    ends = {"start": pin.seats[0].start, "end": pin.seats[-1].end} | {s: f.station for s, f in faces.items()}
    flanges: dict[str, Any] = {"radius": round(min(flange.radius for flange in joint.flanges), 9)}
    # the file counts along its own axis, which may run the other way
    flanges["ends"] = sorted(round(stations.of(station), 9) for station in ends.values())
    if len(faces) == 1:
        [side] = faces
        flanges["sides"] = side if stations.sign > 0 else {"start": "end", "end": "start"}[side]
    play = _play(joint)
    lines = [key_line("flanges", flanges)]
    if play > _LEAST_PLAY:
        return [*lines, key_line("axial_clearance", round(play, 9))]
    if joint.name in shared.axial:
        return [*lines, key_line("axial_clearance", AXIAL_PLAY, "drawn without")]
    text = "drawn without axial play; which play do the tolerances leave at each end?"
    return [*lines, question(f"joints.{joint.name}.axial_clearance", text), "# axial_clearance = 0.05"]


# -- stops ------------------------------------------------------------------------------------------------------------

_DIGITS = 9
_CENTRED = 1e-6  # mm
Side = dict[str, Any]


def stop_tables(found: FoundGeometry) -> list[str]:
    """Return the candidates for stops and latches, marked, below a question; empty if there are none."""
    if not found.stops:
        return []
    text = (
        "which of these faces are stops, or hold a latch? Remove the marks of those; give more points where a whole"
        " face rests on one"
    )
    lines = [question("contacts", text)]
    for stop in found.stops:
        a, b = stop_sides(found, stop)
        table = [f"[contacts.{stop.name}]".ljust(36) + f" # {stop.sizes}", key_line("a", a), key_line("b", b)]
        lines += [*marked([*table, key_line("material", LAW)]), ""]
    return lines


def stop_sides(found: FoundGeometry, stop: FoundStop) -> tuple[Side, Side]:
    """Return the sides a and b of the contact for a candidate; b is on the first of its faces."""
    pair = stop.pair
    first, second = (found.face(number) for number in pair.faces)
    if isinstance(pair, FacingPlanes):
        point = np.round(found.to_body(second.part, pair.middle + pair.gap * pair.normal), _DIGITS)
        return _side(found, second, "point", point), _near_side(found, first, pair.middle)
    return _round_side(found, pair, first, second), _touched_side(found, pair, first)


def _side(found: FoundGeometry, face: CadFace, kind: str, primitive: Any) -> Side:
    return {"body": found.bodies[face.part], kind: primitive}


def _rounded(point: Array) -> Array:
    return np.round(point, _DIGITS) + 0.0  # + 0.0 turns -0.0 into 0.0


def _point(found: FoundGeometry, face: CadFace, point: Array) -> Array:
    """Return a point in the frame of a face's body, given in the assembly's frame."""
    return _rounded(found.to_body(face.part, point))


def _ball(found: FoundGeometry, face: CadFace) -> Side:
    return {"centre": _point(found, face, face.point), "radius": round(face.radius, _DIGITS)}


def _direction(found: FoundGeometry, face: CadFace, vector: Array) -> Array:
    """Return a direction in the frame of a face's body, given in the assembly's frame."""
    return np.round(found.assembly.part(face.part).placement.rotation.T @ vector, 12) + 0.0


def _near_side(found: FoundGeometry, face: CadFace, at: Array) -> Side:
    """Return the side that selects a face by a point on it, such that no other face fits."""
    part, near = PartSearch(found.assembly, face.part, 1.0), np.round(found.to_body(face.part, at), 6) + 0.0
    search = part.plane if face.kind == "plane" else part.face
    wanted = _selects_one({"near": near}, lambda table: search(NearPlace.model_validate(table)))
    wanted = wanted or {"near": near, "within": _NEARER[-1]}
    if face.kind == "plane":
        return _side(found, face, "plane", wanted)
    return _side(found, face, "surface", {"faces": [wanted]})


def _round_side(found: FoundGeometry, pair: FacingRound, touched: CadFace, face: CadFace) -> Side:
    """Return the side of the round face: a ball; the pin itself against a plane; otherwise the arc of a cylinder."""
    if face.kind == "sphere":
        return _side(found, face, "sphere", _ball(found, face))
    station = float(pair.stretch.mean())
    if touched.kind == "plane" and pair.profile is None and face.span >= WHOLE and abs(station) < _CENTRED:
        return side(found, face)
    arc = {
        "centre": _point(found, face, face.point + station * face.axis),
        "normal": _direction(found, face, face.axis),
        "radius": round(face.radius, _DIGITS),
    }
    if face.span < WHOLE:
        arc |= {"middle": _direction(found, face, face.middle), "half_angle": round(face.span / 2, _DIGITS)}
    return _side(found, face, "arc", arc)


def _touched_side(found: FoundGeometry, pair: FacingRound, face: CadFace) -> Side:
    """Return the side of the touched face: by reference to the CAD file, or as its profile in numbers."""
    if pair.profile is not None:
        return _side(found, face, "extruded", _extruded(found, face, pair.profile))
    # a ball can leave a hollow sphere of which no more than half is there, 2 pi r2
    is_open = face.hollow and face.area < 2.1 * np.pi * face.radius**2
    if face.kind == "sphere" and not (face.splines and is_open):
        return _side(found, face, "socket" if face.hollow else "sphere", _ball(found, face))
    if face.kind == "cone" and face.span >= WHOLE:
        return _side(found, face, "turned", _frustum(found, face))
    if face.kind == "cylinder" and (face.span >= WHOLE or not face.splines):
        return side(found, face)
    return _near_side(found, face, pair.middle)


def _extruded(found: FoundGeometry, face: CadFace, profile: ExtrudedProfile) -> Side:
    """Return a profile in the form of a mechanism file."""
    segments = []
    for piece in profile.pieces:
        segment: Side = {"to": _rounded(piece.end)}
        if piece.centre is not None:
            segment |= {"centre": _rounded(piece.centre), "turn": "left" if piece.left else "right"}
        segments.append(segment)
    return {
        "point": _point(found, face, profile.point),
        "axis": _direction(found, face, profile.axis),
        "along": _direction(found, face, profile.along),
        "half_length": round(profile.half_length, _DIGITS),
        "start": _rounded(profile.pieces[0].start),
        "profile": segments,
    }


def _frustum(found: FoundGeometry, cone: CadFace) -> Side:
    """Return a cone as a turned solid: what it encloses, or a ring around it as thick as it widens."""
    low, high = cone.extent
    slope = np.tan(cone.half_angle)
    inner, outer = cone.radius + low * slope, cone.radius + high * slope
    wall = 2 * outer if cone.hollow else 0.0
    corners = [(inner, low), (outer, high), (wall, high), (wall, low)]
    start, *others = (_rounded(np.array(corner)) for corner in corners)
    return {
        "point": _point(found, cone, cone.point),
        "axis": _direction(found, cone, cone.axis),
        "start": start,
        "profile": [{"to": to} for to in others],
    }
