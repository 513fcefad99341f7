"""Pins that slide in slots: not joints, although either end of the slot looks like one."""

import numpy as np

from engine.cad.cad_model import CadAssembly, CadFace
from engine.cad.findings.pins_in_holes import MOST_CLEARANCE, MOST_EXCESS, NearMiss
from engine.cad.findings.slots import slots_of

_PARALLEL = 0.035  # rad
_ALIKE = 1e-6  # mm


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
    return bool(abs(hole.axis @ pin.axis) >= np.cos(_PARALLEL) and shared > 0)


def _allowed(hole: CadFace, pin: CadFace) -> float:
    """Return the allowed distance of a pin from the middle plane of its slot [mm]."""
    return max(hole.radius - pin.radius, 0.0) + MOST_EXCESS
