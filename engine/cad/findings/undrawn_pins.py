"""Pins that are not drawn: coaxial holes of two parts, equal in radius, next to each other and with nothing in them."""

from dataclasses import dataclass

import numpy as np

from engine.arrays import Array
from engine.cad.cad_model import CadAssembly, CadFace, Coordinates, Millimetres
from engine.cad.findings.pins_in_holes import LEAST_SPAN, MOST_EXCESS

MOST_DIFFERENCE = 0.3
"""Largest difference of the radii of two holes for one pin [mm]."""
_MOST_APART = 1.0  # mm between the holes along their axis
_THINNEST = 0.5  # of the radius of a hole, for what counts as something in it
_PARALLEL = 1e-3  # rad


@dataclass(frozen=True, eq=False, kw_only=True)
class UndrawnPin:
    """Two holes in which a pin or a screw may be missing."""

    holes: tuple[int, int]
    """Numbers of the faces."""
    parts: tuple[str, str]
    radii: tuple[float, float]
    point: Coordinates
    """On the axis of the first hole, midway along it, shape (3,) [mm]."""
    axis: Array
    half_length: Millimetres
    """Half the length of the first hole."""


def undrawn_pins(assembly: CadAssembly) -> list[UndrawnPin]:
    """Return the pins that may be missing in an assembly in mm: one for each two parts and axis, in their order."""
    cylinders = [face for face in assembly.faces if face.kind == "cylinder" and face.span > LEAST_SPAN]
    holes, pins = [f for f in cylinders if f.hollow], [f for f in cylinders if not f.hollow]
    empty = [hole for hole in holes if not any(_is_in(pin, hole) for pin in _near(pins, hole))]
    found: list[UndrawnPin] = []
    for first in empty:
        for second in _near(empty, first):
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


def _near(faces: list[CadFace], about: CadFace) -> list[CadFace]:
    """Return the cylinders that are coaxial with another one."""
    if not faces:
        return []
    away = np.array([face.point for face in faces]) - about.point
    far = np.linalg.norm(np.cross(away, about.axis), axis=1)
    turned = np.abs(np.array([face.axis for face in faces]) @ about.axis)
    return [faces[i] for i in np.flatnonzero((far <= MOST_EXCESS) & (turned > np.cos(_PARALLEL)))]


def _stations(face: CadFace, along: CadFace) -> Array:
    """Return start and end of a cylinder along the axis of another one."""
    return np.sort((face.point + np.outer(face.extent, face.axis) - along.point) @ along.axis)


def _is_in(pin: CadFace, hole: CadFace) -> bool:
    """Return whether a pin, which is coaxial with a hole, is in it."""
    start, end = _stations(pin, hole)
    fits = _THINNEST * hole.radius <= pin.radius <= hole.radius + MOST_DIFFERENCE
    return bool(fits and min(end, hole.extent[1]) - max(start, hole.extent[0]) > 0)


def _are_for_one_pin(first: CadFace, second: CadFace) -> bool:
    """Return whether coaxial holes are equal and next to each other."""
    start, end = _stations(second, first)
    apart = max(start - first.extent[1], first.extent[0] - end)
    return bool(abs(first.radius - second.radius) <= MOST_DIFFERENCE and -MOST_EXCESS <= apart <= _MOST_APART)


def _is_known(first: CadFace, second: CadFace, known: UndrawnPin) -> bool:
    """Return whether a pin between the same parts on the same axis has been found."""
    far = np.linalg.norm(np.cross(known.point - first.point, first.axis))
    return {first.part, second.part} == set(known.parts) and bool(far <= MOST_EXCESS)
