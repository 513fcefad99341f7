"""Joints and start gaps in the CAD files, compared with those of a mechanism file."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from engine.arrays import Array
from engine.assembly import assemble
from engine.cad import CadAssembly
from engine.cad.findings.joints import PinInHole, pins_in_holes
from engine.mechanism import Mechanism, mechanism_from
from engine.mechanism.geometry.cad_table import NearEdge, NearPlace, RoundFace
from engine.mechanism.geometry.drawn_features import NotOneFace, PartSearch, contact_side, feature_of

NEAR = 0.05
"""Largest distance between an edge or a plane of the CAD files and that of the mechanism file [mm]."""
BESIDE = 0.5
"""Largest distance between an axis of the CAD files and that of the mechanism file [mm]."""

Gaps = dict[str, float]


@dataclass(frozen=True)
class ComparedJoint:
    """A joint of the mechanism file and the corresponding pin in a hole of the CAD files; lengths in mm."""

    name: str
    drawn_radii: tuple[float, ...]  # of the journal, from the CAD files
    given_radii: tuple[float, ...]  # of the journal, from the mechanism file
    clearance: float  # difference of the drawn radii, the smallest one of the seats
    bearing_off: float  # distance of the mechanism file's point from the axis in the CAD files
    journal_off: float  # like `bearing_off`
    rings_inside: bool  # all rings lie where both pin and hole exist
    # smallest gap of a ring at the start: the file's clearance minus the offset of the axes in the CAD files
    drawn_gap: float
    given_gap: float  # the gap with which a run starts


def start_gaps(mechanism: Mechanism) -> Gaps:
    """Return the gap of each contact at the start, by name."""
    assembly = assemble(mechanism)
    return dict(zip(assembly.contact_names, assembly.state.gap.tolist(), strict=True))


def compared_joints(assembly: CadAssembly, mechanism: Mechanism) -> tuple[dict[str, ComparedJoint], list[PinInHole]]:
    """Return the joints of a mechanism that are in the CAD files, and the pins in holes that match no joint.

    All bodies of the assembly are in the start pose of the mechanism [mm].
    """
    found, gaps = pins_in_holes(assembly)[0], start_gaps(mechanism)
    compared: dict[str, ComparedJoint] = {}
    others = []
    for pin in found:
        name = next((name for name in mechanism.loose_joints() if _is_there(assembly, mechanism, name, pin)), None)
        if name is None:
            others.append(pin)
        else:
            compared[name] = _compared(assembly, mechanism, name, pin, gaps)
    return compared, others


def _is_there(assembly: CadAssembly, mechanism: Mechanism, name: str, pin: PinInHole) -> bool:
    """Return whether a pin in a hole corresponds to a joint of the mechanism."""
    joint = mechanism.joints[name]
    if (joint.sides[0].body, joint.sides[1].body) != (pin.bearing, pin.journal):
        return False
    return max(_off(assembly, joint, pin)) <= BESIDE


def _off(assembly: CadAssembly, joint: Any, pin: PinInHole) -> tuple[float, float]:
    """Return the distances of a joint's points from the axes of hole and pin."""
    lines = (pin.point, pin.axis), (pin.journal_point, pin.journal_axis)
    bearing, journal = (
        _to_line(assembly.part(side.body).placement.to_assembly(np.array(side.point, float)), *line)
        for side, line in zip(joint.sides, lines, strict=True)
    )
    return bearing, journal


def _to_line(point: Array, on: Array, along: Array) -> float:
    """Return the distance of a point from a line."""
    away = point - on
    return float(np.linalg.norm(away - (away @ along) * along))


def _compared(
    assembly: CadAssembly, mechanism: Mechanism, name: str, pin: PinInHole, gaps: Mapping[str, float]
) -> ComparedJoint:
    """Return the comparison of a joint with its pin in a hole."""
    joint: Any = mechanism.joints[name]
    placement = assembly.part(joint.sides[0].body).placement
    way = placement.matrix @ np.array(joint.axes[0], float)
    centre = placement.to_assembly(np.array(joint.sides[0].point, float)) - pin.point
    at = [float((centre + ring * way) @ pin.axis) for ring in joint.rings]
    seats = [(seat.start, seat.end) for seat in pin.seats]
    off = _off(assembly, joint, pin)
    return ComparedJoint(
        name=name,
        drawn_radii=tuple(dict.fromkeys(round(seat.pin_radius, 4) for seat in pin.seats)),
        given_radii=tuple(dict.fromkeys(joint.radii)),
        clearance=min(seat.hole_radius - seat.pin_radius for seat in pin.seats),
        bearing_off=off[0],
        journal_off=off[1],
        rings_inside=all(any(start <= ring <= end for start, end in seats) for ring in at),
        drawn_gap=joint.radial_clearance - pin.offset,
        given_gap=min(gaps[f"{name}.ring{i}"] for i, _ in enumerate(joint.rings, 1)),
    )


def compared_contacts(assembly: CadAssembly, mechanism: Mechanism) -> Iterator[tuple[str, float, float | None]]:
    """Yield each contact with its gap at the start, and the gap between the corresponding edges and faces in CAD.

    The latter is None if the CAD files have no such edge or face, or several.
    """
    given = start_gaps(mechanism)
    numbers = mechanism.with_tables({}, {})  # in place of formulas over parameters
    tables = numbers.model_dump(mode="json", by_alias=True, exclude_unset=True, exclude_none=True)
    for key in ("benches", "parameters"):
        tables.pop(key, None)
    drawn = {}
    for name, contact in tables["contacts"].items():
        try:
            drawn[name] = {**contact, **{side: _drawn_side(assembly, contact, side) for side in ("a", "b")}}
        except NotOneFace:
            continue
    replaced = start_gaps(mechanism_from({**tables, "contacts": tables["contacts"] | drawn}, mechanism.name))
    for name in tables["contacts"]:
        yield name, given[name], replaced[name] if name in drawn else None


def _drawn_side(assembly: CadAssembly, contact: Mapping[str, Any], side: str) -> dict[str, Any]:
    """Return a side of a contact with the primitive of the CAD files; raise NotOneFace unless there is exactly one."""
    table = contact[side]
    [kind] = table.keys() - {"body", "within"}
    if table["body"] not in {part.name for part in assembly.parts}:
        raise NotOneFace(f"no file of {table['body']}")
    search, shape = PartSearch(assembly, table["body"], 1.0), table[kind]
    if kind not in ("arc", "cylinder", "plane", "rectangle"):
        raise NotOneFace(f"a {kind} is not looked for")
    if kind == "arc":
        apex = np.array(shape["centre"]) + shape["radius"] * np.array(shape["middle"])
        edge = feature_of(search, "arc", NearEdge(edge=NearPlace(near=apex.tolist(), within=NEAR)))
        return {"body": table["body"], **contact_side(search, "arc", edge, "")}
    if kind == "cylinder":
        pin = feature_of(search, "pin", RoundFace(radius=shape["radius"], near=shape["point"], within=BESIDE))
        return {"body": table["body"], **contact_side(search, "pin", pin, "plane")}
    at, given = shape["point" if kind == "plane" else "centre"], shape["normal"]
    flat = contact_side(search, "plane", search.plane(NearPlace(near=at, within=NEAR)), "")["plane"]
    normal, on = np.array(flat["normal"]), np.array(flat["point"])
    if normal @ np.array(given) < 0:  # a face without a solid has no outside
        normal = -normal
    if kind == "plane":
        return {"body": table["body"], "plane": {"point": on.tolist(), "normal": normal.tolist()}}
    moved = np.array(at) + ((on - np.array(at)) @ normal) * normal
    return {"body": table["body"], "rectangle": {**shape, "centre": moved.tolist()}}
