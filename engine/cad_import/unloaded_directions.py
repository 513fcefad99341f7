"""Motions of a proposed mechanism that no load acts on yet: gravity and loads will have to act on them."""

import tomllib
from typing import Any

import numpy as np

from engine.cad_import.found_geometry import FoundGeometry
from engine.cad_import.proposed_mechanism import largest_part
from engine.errors import EngineError
from engine.mechanism import mechanism_from
from engine.mechanism.geometry.resolved_geometry import UnresolvedGeometry, without_selectors
from engine.preflight.cautions import MOST_BODIES

_SOME_DENSITY, _SOME_PLAY = 7.85e-3, 0.05  # g/mm3, mm: the free motions depend on neither
_SOME_BODY = {"mass": 1.0, "center_of_mass": [0.0, 0.0, 0.0], "inertia": [1.0, 1.0, 1.0]}


def unloaded_directions(found: FoundGeometry, text: str) -> list[str]:
    """Return the motions that no load acts on, with the largest part fixed, each with the body that has most of it.

    A motion is for instance ``"crank along z, the axis of J"``. The questions of the proposed `text` are answered with
    arbitrary numbers, because the free motions do not depend on densities and plays. Empty also if the parts cannot
    start as they are drawn.
    """
    if not 1 < len(found.assembly.parts) <= MOST_BODIES:
        return []
    from engine.assembly import assemble
    from engine.preflight.small_motions import small_motions
    from engine.preflight.unloaded import unloaded_motions

    try:
        plain, _ = without_selectors(_answered(found, tomllib.loads(text)), found.assembly)
        mechanism = mechanism_from(plain, "proposal")
        return [" ".join(each) for each in unloaded_motions(mechanism, small_motions(assemble(mechanism)))]
    except (UnresolvedGeometry, EngineError):
        return []


def _answered(found: FoundGeometry, tables: dict[str, Any]) -> dict[str, Any]:
    """Return the tables of a proposed file with arbitrary answers to its questions about bodies and joints."""
    fixed = found.bodies[largest_part(found.assembly).name]
    for name, body in tables["bodies"].items():
        body.update({"fixed": True} if name == fixed else {"density": _SOME_DENSITY})
    for part in found.assembly.parts:
        if not part.solids:
            tables["bodies"][found.bodies[part.name]] |= _SOME_BODY
    for joint in found.joints:
        table = tables["joints"][joint.name]
        if "radial_clearance" not in table or joint.pin.overlap > 0:
            # large enough for the pose as drawn: pin and hole that overlap cannot start
            table["radial_clearance"] = joint.pin.offset + _SOME_PLAY
        if "flanges" in table:
            table.setdefault("axial_clearance", _SOME_PLAY)
    for each in found.balls:
        tables["joints"][each.name]["radial_clearance"] = (
            float(np.linalg.norm(each.ball.ball_centre - each.ball.centre)) + _SOME_PLAY
        )
    return tables
