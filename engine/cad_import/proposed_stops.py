"""The tables of contacts that may be stops or latches, marked as inactive: two faces that face each other."""

from typing import Any

import numpy as np

from engine.arrays import Array
from engine.cad import CadFace
from engine.cad.findings import ExtrudedProfile, FacingPlanes, FacingRound
from engine.cad.findings.facing_rounds import WHOLE
from engine.cad_import.found_geometry import FoundGeometry, FoundStop
from engine.cad_import.proposed_joints import LAW, NEARER, side
from engine.cad_import.proposed_text import key_line, marked, question
from engine.mechanism.geometry.cad_table import NearPlace
from engine.mechanism.geometry.face_search import NotOneFace, PartSearch

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


def _point(found: FoundGeometry, face: CadFace, point: Array) -> Array:
    """Return a point in the frame of a face's body, given in the assembly's frame."""
    return np.round(found.to_body(face.part, point), _DIGITS) + 0.0


def _direction(found: FoundGeometry, face: CadFace, vector: Array) -> Array:
    """Return a direction in the frame of a face's body, given in the assembly's frame."""
    return np.round(found.assembly.part(face.part).placement.rotation.T @ vector, 12) + 0.0


def _near_side(found: FoundGeometry, face: CadFace, at: Array) -> Side:
    """Return the side that selects a face by a point on it, such that no other face fits."""
    search, near = PartSearch(found.assembly, face.part, 1.0), np.round(found.to_body(face.part, at), 6) + 0.0
    searched = search.plane if face.kind == "plane" else search.face
    wanted: Side = {"near": near}
    for within in NEARER:
        wanted = {"near": near} if within is None else {"near": near, "within": within}
        try:
            searched(NearPlace.model_validate({**wanted, "near": near.tolist()}))
            break
        except NotOneFace:
            continue
    return (
        _side(found, face, "plane", wanted)
        if face.kind == "plane"
        else _side(found, face, "surface", {"faces": [wanted]})
    )


def _round_side(found: FoundGeometry, pair: FacingRound, touched: CadFace, face: CadFace) -> Side:
    """Return the side of the round face: a ball; the pin itself against a plane; otherwise the arc of a cylinder."""
    if face.kind == "sphere":
        ball = {"centre": _point(found, face, face.point), "radius": round(face.radius, _DIGITS)}
        return _side(found, face, "sphere", ball)
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
    if face.kind == "sphere" and not (face.hollow and face.splines and _is_open(face)):
        ball = {"centre": _point(found, face, face.point), "radius": round(face.radius, _DIGITS)}
        return _side(found, face, "socket" if face.hollow else "sphere", ball)
    if face.kind == "cone" and face.span >= WHOLE:
        return _side(found, face, "turned", _frustum(found, face))
    if face.kind == "cylinder" and (face.span >= WHOLE or not face.splines):
        return side(found, face)
    return _near_side(found, face, pair.middle)


def _is_open(socket: CadFace) -> bool:
    """Return whether a ball can leave a hollow sphere, because no more than half of the sphere is there."""
    return socket.area < 2.1 * np.pi * socket.radius**2  # half a sphere has 2 pi r2


def _extruded(found: FoundGeometry, face: CadFace, profile: ExtrudedProfile) -> Side:
    """Return a profile in the form of a mechanism file."""
    segments = []
    for piece in profile.pieces:
        segment: Side = {"to": _plane_point(piece.end)}
        if piece.centre is not None:
            segment |= {"centre": _plane_point(piece.centre), "turn": "left" if piece.left else "right"}
        segments.append(segment)
    return {
        "point": _point(found, face, profile.point),
        "axis": _direction(found, face, profile.axis),
        "along": _direction(found, face, profile.along),
        "half_length": round(profile.half_length, _DIGITS),
        "start": _plane_point(profile.pieces[0].start),
        "profile": segments,
    }


def _plane_point(point: Array) -> Array:
    return np.round(point, _DIGITS) + 0.0


def _frustum(found: FoundGeometry, cone: CadFace) -> Side:
    """Return a cone as a turned solid: what it encloses, or a ring around it as thick as it widens."""
    low, high = cone.extent
    slope = np.tan(cone.half_angle)
    inner, outer = cone.radius + low * slope, cone.radius + high * slope
    wall = 2 * outer if cone.hollow else 0.0
    corners = [(inner, low), (outer, high), (wall, high), (wall, low)]
    start, *others = (_plane_point(np.array(corner)) for corner in corners)
    return {
        "point": _point(found, cone, cone.point),
        "axis": _direction(found, cone, cone.axis),
        "start": start,
        "profile": [{"to": to} for to in others],
    }
