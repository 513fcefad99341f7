"""Faces across a joint's axis that limit the sliding of its pin: ends of the bearing, flanges of the journal."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from engine.arrays import Array
from engine.cad.cad_model import CadAssembly, CadFace, Millimetres
from engine.cad.findings.facing_planes import contains
from engine.cad.findings.pins_in_holes import MOST_EXCESS, PinInHole
from engine.cad.geometry import perpendicular

MOST_PLAY = 1.0
"""Largest axial play at one end [mm] at which a face counts as a flange."""
_DEEPEST_OVERLAP = 0.02  # mm
_ACROSS = 1e-4  # rad between a plane's normal and the axis
_WIDEST = 3.0  # multiple of the hole's radius
_SHRUNK = 0.985  # factor, so that the chords of a mesh do not cut off a circle
_ANGLES, _RADII = 24, 41
Radii = tuple[float, float]


@dataclass(frozen=True, eq=False, kw_only=True)
class ThrustFaces:
    """An end face of a bearing and the flange of its journal that can touch it."""

    side: Literal["start", "end"]
    """The end of the bearing along the joint's axis."""
    bearing_face: int
    journal_face: int
    station: Millimetres
    """Position of the bearing's end face along the joint's axis, measured from its point [mm]."""
    play: Millimetres
    """Distance between the two faces as posed [mm]; negative where they overlap."""
    radius: Millimetres
    """Radius of the largest circle about the axis that lies in both faces [mm]."""


def thrust_faces(assembly: CadAssembly, joint: PinInHole, triangles: dict[int, Array]) -> list[ThrustFaces]:
    """Return the nearest end face and flange at each end of a joint; none where the pin is free to slide."""
    found = []
    for way in (-1.0, 1.0):
        outward = way * joint.axis
        ends = _across(assembly, joint.bearing, outward)
        flanges = _across(assembly, joint.journal, -outward)
        tried = [
            pair
            for end in ends
            for flange in flanges
            if (pair := _pair(assembly, joint, (end, flange), way, triangles)) is not None
        ]
        if tried:
            found.append(min(tried, key=lambda pair: pair.play))
    return found


def _across(assembly: CadAssembly, part: str, normal: Array) -> list[CadFace]:
    """Return the plane faces of a part with a given normal."""
    return [f for f in assembly.faces_of(part) if f.kind == "plane" and f.axis @ normal > np.cos(_ACROSS)]


def _pair(
    assembly: CadAssembly, joint: PinInHole, faces: tuple[CadFace, CadFace], way: float, triangles: dict[int, Array]
) -> ThrustFaces | None:
    """Return an end face and a flange that can touch; None if they cannot."""
    end, flange = faces
    station = float((end.point - joint.point) @ joint.axis)
    play = float((flange.point - end.point) @ joint.axis) * way
    middle = (joint.seats[0].start + joint.seats[-1].end) / 2
    if (station - middle) * way <= 0 or not -_DEEPEST_OVERLAP <= play <= MOST_PLAY:
        return None
    hole = max(seat.hole_radius for seat in joint.seats)
    for radius, tested in _radii(assembly, joint, faces, hole):
        circle = _circle(joint, station, tested)
        if contains(triangles[end.number], circle, joint.axis).all() and (
            contains(triangles[flange.number], circle, joint.axis).all()
        ):
            return ThrustFaces(
                side="end" if way > 0 else "start",
                bearing_face=end.number,
                journal_face=flange.number,
                station=station,
                play=play,
                radius=radius,
            )
    return None


def _radii(assembly: CadAssembly, joint: PinInHole, faces: tuple[CadFace, CadFace], hole: float) -> list[Radii]:
    """Return radii to be tried, the largest first, each with the radius of the points that must lie in both faces."""
    numbers = {face.number for face in faces}
    edges = [e for e in assembly.edges if numbers & set(e.faces) and e.radius > hole]
    away = [edge.centre - joint.point for edge in edges]
    about = [
        edge.radius
        for edge, each in zip(edges, away, strict=True)
        if np.linalg.norm(each - (each @ joint.axis) * joint.axis) <= joint.radial_clearance + MOST_EXCESS
    ]
    between = np.linspace(hole, _WIDEST * hole, _RADII)[1:].tolist()
    return sorted([*((r, _SHRUNK * r) for r in about), *((r, r) for r in between)], reverse=True)


def _circle(joint: PinInHole, station: float, radius: float) -> Array:
    """Return points on a circle about a joint's axis, shape (n, 3)."""
    angles = np.linspace(0.0, 2 * np.pi, _ANGLES, endpoint=False)
    around = np.column_stack([np.cos(angles), np.sin(angles)]) @ perpendicular(joint.axis)
    points: Array = joint.point + station * joint.axis + radius * around
    return points
