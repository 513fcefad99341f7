"""The text of a mechanism file, proposed from the features found in a CAD file.

Motions that no load acts on yet are named in it: gravity and loads will have to act on them.
"""

import re
import time
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from engine.cad.cad_model import CadAssembly, CadPart
from engine.cad.findings.standard_parts import Coil, gear_teeth
from engine.cad_import.drawn_tolerances import Diameter, all_diameters, all_zones
from engine.cad_import.found_geometry import FoundGeometry, FoundSpring
from engine.cad_import.proposed_groups import PartGroup
from engine.cad_import.proposed_joints import (
    AXIAL_PLAY,
    LAW,
    RADIAL_PLAY,
    SharedQuestions,
    ball_lines,
    free_joints,
    joint_lines,
    pivot_tables,
    play_parameters,
    shared_questions,
    stop_tables,
)
from engine.cad_import.proposed_text import key_line, marked, question, value
from engine.errors import EngineError, some
from engine.mechanism import mechanism_from
from engine.mechanism.geometry.resolved_geometry import UnresolvedGeometry, without_selectors
from engine.preflight.cautions import MOST_BODIES

_HEAD = """\
# Proposed by clearcap mechanism import. A line that begins with #? asks what no CAD file says: answer it, by removing
# the mark before a line or by writing your own, and then remove the question. clearcap mechanism check names those
# that are still open. Points of a body are in the frame of its part.
"""

_SIMULATION = """\
[simulation]
step = 5e-3                          # ms
horizon = 500.0                      # ms
penetration = 1e-7                   # mm
adaptive = { longest = 0.2, travel = 5e-3 }
rest = { window = 10.0, drift = 1e-5 }
"""

_SOME_DENSITY, _SOME_PLAY = 7.85e-3, 0.05  # g/mm3, mm: the free motions depend on neither
_SHEAR_MODULUS = 81_500.0  # N/mm2, of spring wire, EN 13906-1
_UNLOADED_SECONDS = 10.0  # of the processor
_FEWEST_GEARS, _SOME_TEETH = 2, 20
_MOST_MOTIONS = 8  # without load, that the question about loads names
_ALL_WAYS = frozenset(f"{way} {axis}" for way in ("along", "about") for axis in "xyz")
_SOME_BODY = {"mass": 1.0, "center_of_mass": [0.0, 0.0, 0.0], "inertia": [1.0, 1.0, 1.0]}


@dataclass(frozen=True)
class UnloadedMotions:
    """Motions that no load acts on, each with the body that has most of it: ``"crank along z, the axis of J"``."""

    motions: tuple[str, ...] = ()
    unseen: str = ""  # why there may be more; empty if all are known


NOT_SOUGHT = UnloadedMotions()


def proposed_mechanism(
    found: FoundGeometry,
    file: str,
    name: str,
    unloaded: UnloadedMotions = NOT_SOUGHT,
    listed: Sequence[PartGroup] | None = None,
) -> str:
    """Return the text of a mechanism file; `file` is the path of the CAD file relative to it.

    `unloaded` is the result of `unloaded_directions` for the text without it. `listed` are the groups in its
    ``[groups]``; without them, those of which its bodies are made.
    """
    assembly, shared = found.assembly, shared_questions(found)
    lines = [
        _HEAD,
        "format = 1",
        key_line("name", name),
        'units = "mm-g-ms"',
        *_gravity(found),
        "",
        *_groups(found.groups if listed is None else listed),
        *_parameters(found, shared),
        "[cad]",
        key_line("file", file),
        key_line("sha256", assembly.sha256),
        key_line("recognition", assembly.recognition),
        *([key_line("accept_damage", True)] if assembly.damage else []),
        *_default_density(found.drawn),
        "",
        _SIMULATION,
        f"[materials.{LAW}]",
        question(f"materials.{LAW}.friction", "which coefficient of friction do the parts have?"),
        "friction = 0.0",
        "",
    ]
    largest = largest_part(assembly).name
    for part in assembly.parts:
        lines += _body(found, part, is_largest=part.name == largest)
    lines += free_joints(shared)
    for joint in found.joints:
        lines += joint_lines(found, joint, shared)
    for ball in found.balls:
        lines += ball_lines(found, ball, shared)
    lines += [
        *pivot_tables(found),
        *stop_tables(found),
        *_springs(found),
        *_gears(found),
        *_loads(unloaded),
        *_responses(found),
    ]
    return "\n".join(lines).rstrip("\n") + "\n"


def _groups(groups: Sequence[PartGroup]) -> list[str]:
    """Return the table of the groups, in which a person edits them."""
    if not groups:
        return []
    text = (
        "is each of these one rigid body, and is no other? Edit the lists, and clearcap mechanism import with the STEP"
        " file and --update with this file brings bodies, joints and stops to them"
    )
    lines = [key_line(_bare(group.name), list(group.parts), group.why) for group in groups]
    return ["[groups]", question("groups", text), *lines, ""]


def _bare(name: str) -> str:
    """Return a key of TOML, in quotes where it needs them."""
    return name if re.fullmatch(r"[A-Za-z_][\w-]*", name, re.ASCII) else value(name)


def largest_part(assembly: CadAssembly) -> CadPart:
    """Return the part with the largest volume: it may be the fixed one, which nobody has named yet."""
    return max(assembly.parts, key=lambda part: sum(solid.volume for solid in part.solids))


def _gravity(found: FoundGeometry) -> list[str]:
    """Return the question about attitude and gravity, with the axes along which parts are loose."""
    axes = {tuple(np.round(np.abs(joint.pin.axis), 3) + 0.0) for joint in found.joints if joint.flanges}
    loose = " and ".join(f"[{', '.join(f'{x:g}' for x in axis)}]" for axis in sorted(axes))
    text = "which way is down? Along a direction that neither gravity nor a load acts on, parts float and never rest"
    if loose:
        text += f"; here joints have axial play along {loose}"
    return [question("gravity", text), *marked([key_line("gravity", [0.0, 0.0, -9.81e-3], "mm/ms2")])]


def _parameters(found: FoundGeometry, shared: SharedQuestions) -> list[str]:
    """Return the diameters with limits, to be varied by a campaign, and the plays that are asked for."""
    diameters, plays = all_diameters(found), play_parameters(shared)
    shares = [key_line(zone.share, 0.0, f"of the radius of {zone.words}") for zone in all_zones(found) if zone.share]
    if not diameters and not plays:  # a share depends on a diameter
        return []
    lines = [key_line(d.parameter, d.value, f"mm, {_stated(d)} in the CAD file") for d in diameters]
    return ["[parameters]", *lines, *shares, *plays, ""]


def _stated(diameter: Diameter) -> str:
    """Return the limits of a diameter in words."""
    return diameter.words if diameter.tolerance_class else f"{diameter.lower:.6g} to {diameter.upper:.6g}"


def _default_density(assembly: CadAssembly) -> list[str]:
    """Return the question about the density of all parts of which the CAD file has none."""
    materials = {part.name: [solid.material or part.material for solid in part.solids] for part in assembly.parts}
    without = [name for name, each in materials.items() if not all(material and material.density for material in each)]
    if not without:
        return []
    text = (
        f"the CAD file has no density of {some(without)}; which is it, in g/mm3, or of which material are they? One"
        " that has another density gets it in the table of its body"
    )
    return [question("cad.density", text), '# density = "steel"']


def _body(found: FoundGeometry, part: CadPart, *, is_largest: bool) -> list[str]:
    """Return the table of a body."""
    name = found.bodies[part.name]
    path = " / ".join(filter(None, part.path))
    group = next((each for each in found.groups if each.name == part.name), None)
    lines = [f"[bodies.{name}]"]
    if group is None:
        lines.append(key_line("part", part.name, path if path != part.name else ""))
    else:
        lines.append(key_line("parts", list(group.parts)))
    if is_largest:
        lines += [question("bodies", "which part is fixed? This is the largest"), "# fixed = true"]
    if not part.solids:
        text = "it has surfaces only, no solid: what are its mass, center_of_mass and inertia?"
        lines.append(question(f"bodies.{name}.mass", text))
    return [*lines, ""]


def _springs(found: FoundGeometry) -> list[str]:
    """Return the tables of the springs, marked, below a question; empty if there are none."""
    if not found.springs:
        return []
    texts = ["is each of these a spring between the bodies at its ends? It is no body itself"]
    if any(spring.coil for spring in found.springs):
        texts.append("The stiffness of a coil is that of steel wire, its free_length as drawn, so without a force")
    if by_name := [spring.name for spring in found.springs if spring.coil is None]:
        texts.append(f"Of {some(by_name)} only the name says that they are springs")
    lines = [question("springs", f"{'. '.join(texts)}: correct the numbers")]
    for spring in found.springs:
        lines += [
            *marked(_coil_lines(found, spring, spring.coil) if spring.coil else _named_spring_lines(found, spring)),
            "",
        ]
    return lines


def _ends(found: FoundGeometry, spring: FoundSpring) -> list[dict[str, Any]]:
    """Return body and point of both ends of a spring."""
    return [
        {"body": found.bodies[part], "point": np.round(found.to_body(part, end), 6) + 0.0}
        if part
        else {"body": "NAME", "point": [0.0, 0.0, 0.0]}
        for part, end in zip(spring.ends, spring.points, strict=True)
    ]


def _coil_lines(found: FoundGeometry, spring: FoundSpring, coil: Coil) -> list[str]:
    """Return the table of a coil."""
    stiffness = _SHEAR_MODULUS * coil.wire**4 / (8 * coil.diameter**3 * coil.turns)
    wire = f"{coil.turns:.3g} turns of {coil.wire:.3g} mm wire"
    first, second = _ends(found, spring)
    return [
        f"[springs.{spring.name}]".ljust(36) + f" # {wire}",
        'type = "linear"',
        key_line("a", first),
        key_line("b", second),
        key_line("stiffness", float(f"{stiffness:.3g}"), "N/mm"),
        key_line("free_length", round(coil.length, 6), "mm"),
    ]


def _named_spring_lines(found: FoundGeometry, spring: FoundSpring) -> list[str]:
    """Return the table of a spring without a known stiffness, which turns parts if it has turns and is no coil."""
    first, second = _ends(found, spring)
    header = f"[springs.{spring.name}]".ljust(36) + " # by its name"
    if spring.axis is None:
        length = float(np.linalg.norm(spring.points[1] - spring.points[0])) if all(spring.ends) else 0.0
        lines = [key_line("a", first), key_line("b", second), key_line("stiffness", 1.0, "N/mm, to be corrected")]
        return [header, 'type = "linear"', *lines, key_line("free_length", round(length, 6), "mm, to be corrected")]
    part = spring.ends[0]
    axis = found.assembly.part(part).placement.rotation.T @ spring.axis if part else spring.axis
    return [
        header,
        'type = "torsion"',
        key_line("a", first["body"]),
        key_line("b", second["body"]),
        key_line("axis", np.round(axis, 9) + 0.0),
        key_line("stiffness", 1.0, "N mm/rad, to be corrected"),
        key_line("free_angle", 0.0, "rad, to be corrected"),
    ]


def _gears(found: FoundGeometry) -> list[str]:
    """Return the question which gears mesh, with a marked pair; empty if fewer than two parts are gears by name."""
    teeth = {part.name: gear_teeth(part.product or part.name) for part in found.assembly.parts}
    gears = {part: number for part, number in teeth.items() if number is not None}
    if len(gears) < _FEWEST_GEARS:
        return []
    text = (
        f"which of {some([found.bodies[part] for part in gears])} mesh? They are gears by their names, and their teeth"
        " are no contacts here: write each pair, with the module and backlash of its drawing"
    )
    pair = [_gear(found, part, number) for part, number in list(gears.items())[:_FEWEST_GEARS]]
    lines = [
        "[couplings.mesh]",
        key_line("gears", pair),
        key_line("module", 1.0, "mm, to be corrected"),
        key_line("backlash", 0.05, "mm, to be corrected"),
    ]
    return [question("couplings", text), *marked(lines), ""]


def _gear(found: FoundGeometry, part: str, teeth: int) -> dict[str, Any]:
    """Return a gear on the axis of the first joint of its part, or of its largest cylinder."""
    axes = [
        (joint.pin.point, joint.pin.axis) for joint in found.joints if part in (joint.pin.journal, joint.pin.bearing)
    ]
    round_faces = [face for face in found.assembly.faces_of(part) if face.kind == "cylinder"]
    axes += [(face.point, face.axis) for face in sorted(round_faces, key=lambda face: -face.area)]
    point, axis = axes[0] if axes else (np.zeros(3), np.array([0.0, 0.0, 1.0]))
    return {
        "body": found.bodies[part],
        "point": np.round(found.to_body(part, point), 6) + 0.0,
        "axis": np.round(found.assembly.part(part).placement.rotation.T @ axis, 9) + 0.0,
        "teeth": teeth or _SOME_TEETH,
    }


def _loads(unloaded: UnloadedMotions) -> list[str]:
    text = "what drives the mechanism? Springs, forces and torques are in no CAD file"
    if unloaded.motions:
        text += f". Nothing acts yet on {_folded(unloaded.motions)}: what is neither loaded nor held along these"
        text += f" never rests{f' ({unloaded.unseen})' if unloaded.unseen else ''}"
    elif unloaded.unseen:
        text += f". What nothing acts on is {unloaded.unseen}"
    example = ["[torques.drive]", 'body = "NAME"', "torque = [0.0, 0.0, 10.0]            # N mm"]
    return [question("loads", text), *marked(example), ""]


def _folded(motions: Sequence[str]) -> str:
    """Return motions in words, those of a body that is free in all directions as one; of many only the first."""
    of_body: dict[str, list[str]] = {}
    for motion in motions:
        body, _, way = motion.partition(" ")
        of_body.setdefault(body, []).append(way)
    free = {body for body, ways in of_body.items() if set(ways) >= _ALL_WAYS}
    each = list(dict.fromkeys(f"{b} in all directions" if (b := m.partition(" ")[0]) in free else m for m in motions))
    more = len(each) - _MOST_MOTIONS
    return "; ".join(each[:_MOST_MOTIONS]) + (f"; and {more} more" if more > 0 else "")


def _responses(found: FoundGeometry) -> list[str]:
    example = [
        "[responses.force]",
        'type = "contact_force"',
        f'contact = "{found.stops[0].name if found.stops else "NAME"}"',
    ]
    return [question("responses", "what is read off at the end?"), *marked(example)]


def unloaded_directions(found: FoundGeometry, text: str, seconds: float = _UNLOADED_SECONDS) -> UnloadedMotions:
    """Return the motions that no load acts on, with the largest part fixed, as far as `seconds` of the processor reach.

    The questions of the proposed `text` are answered with arbitrary numbers, because the free motions do not depend on
    densities and plays. There are none if the parts cannot start as they are drawn.
    """
    parts = len(found.assembly.parts)
    if not 1 < parts <= MOST_BODIES:
        return UnloadedMotions(unseen=f"not looked for among {parts} parts, only up to {MOST_BODIES}")
    from engine.assembly import assemble
    from engine.preflight.motion_cautions import unloaded_motions
    from engine.preflight.small_motions import small_motions

    motions: list[str] = []
    try:
        plain, _ = without_selectors(_answered(found, tomllib.loads(text)), found.drawn)
        mechanism = mechanism_from(plain, "proposal")
        small = small_motions(assemble(mechanism))
        end = time.process_time() + seconds  # what comes before may compile
        for each in unloaded_motions(mechanism, small):
            motions.append(" ".join(each))
            if time.process_time() > end:
                return UnloadedMotions(tuple(motions), f"the search for others was ended after {seconds:g} s")
    except (UnresolvedGeometry, EngineError):
        return UnloadedMotions(unseen="not known, because the parts cannot start as they are drawn")
    return UnloadedMotions(tuple(motions))


def _answered(found: FoundGeometry, tables: dict[str, Any]) -> dict[str, Any]:
    """Return the tables of a proposed file with arbitrary answers to its questions about bodies and joints."""
    fixed = found.bodies[largest_part(found.assembly).name]
    for name, body in tables["bodies"].items():
        body.update({"fixed": True} if name == fixed else {"density": _SOME_DENSITY})  # of all solids
    for part in found.assembly.parts:
        if not part.solids:
            tables["bodies"][found.bodies[part.name]] |= _SOME_BODY
    for joint in found.joints:
        table = tables["joints"][joint.name]
        if table.get("radial_clearance", RADIAL_PLAY) == RADIAL_PLAY or joint.pin.overlap > 0:
            # large enough for the pose as drawn: pin and hole that overlap cannot start
            table["radial_clearance"] = joint.pin.offset + _SOME_PLAY
        if "flanges" in table and table.get("axial_clearance", AXIAL_PLAY) == AXIAL_PLAY:
            table["axial_clearance"] = _SOME_PLAY
    for each in found.balls:
        offset = float(np.linalg.norm(each.ball.ball_centre - each.ball.centre))
        tables["joints"][each.name]["radial_clearance"] = offset + _SOME_PLAY
    return tables
