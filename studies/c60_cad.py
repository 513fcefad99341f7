"""Comparison of the C-60 in the CAD files published by its authors with the numbers of `c60.toml`.

`python -m studies.c60_cad FOLDER` prints the tables. FOLDER is that of the model Trip_Magnetic of siconos-tutorials,
which contains the folder CAD; the files, listed in c60_cad.toml, are not part of this project (docs/cad.md).
"""

import argparse
import tomllib
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from engine import load_mechanism
from engine.arrays import Array
from engine.assembly import assemble
from engine.cad import CadAssembly, CadPart, read_step
from engine.cad.cad_model import Placement, ProductGeometry, TriangleMesh, placed_product
from engine.cad.findings.joints import PinInHole, pins_in_holes
from engine.mechanism import Mechanism, mechanism_from
from engine.mechanism.geometry.cad_table import NearEdge, NearPlace, RoundFace
from engine.mechanism.geometry.drawn_features import NotOneFace, PartSearch, contact_side, feature_of
from studies import head, show

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
    """Return the joints that are in the CAD files, at the start [mm], and the pins in holes that match no joint."""
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
    """Yield each contact with its gap at the start, and the gap between the corresponding edges and faces in CAD."""
    # The latter is None if the CAD files have no such edge or face, or several.
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


def listed_names() -> dict[str, list[str]]:
    """Return the authors' files by body, relative to their folder."""
    return tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))


def listed_files(folder: Path) -> dict[str, list[Path]]:
    """Return those of the authors' files that a folder has, by body."""
    listed = {body: [folder / name for name in names] for body, names in listed_names().items()}
    return {body: [path for path in paths if path.is_file()] for body, paths in listed.items()}


def posed_assembly(files: Mapping[str, Sequence[Path]], mechanism: Mechanism) -> CadAssembly:
    """Return all files, each in the frame of its body [mm], as one assembly in the start pose of the mechanism."""
    bodies, first_face = [], 0
    for name, paths in files.items():
        placement = start_pose(mechanism, name)
        pieces = [_product(path) for path in paths]
        for piece in pieces:
            bodies.append((name, placement, placed_product(piece, name, placement, first_face)))
            first_face += len(piece.faces)
    parts = {name: _part(name, placement) for name, placement, _ in bodies}
    return CadAssembly(
        sha256="",
        unit="mm",
        schema="",
        recognition=0.0,
        parts=tuple(parts.values()),
        faces=tuple(face for _, _, body in bodies for face in body.faces),
        edges=tuple(edge for _, _, body in bodies for edge in body.edges),
        meshes=tuple(_joined(name, [body for owner, _, body in bodies if owner == name]) for name in parts),
    )


def start_pose(mechanism: Mechanism, name: str) -> Placement:
    """Return the placement of the frame of a body at the start."""
    body = mechanism.bodies[name]
    turn = Rotation.from_rotvec(body.angle * np.array(body.axis) / np.linalg.norm(body.axis)).as_matrix()
    return Placement(rotation=turn, translation=np.array(body.origin, float))


def _product(path: Path) -> ProductGeometry:
    """Return the content of a file as one product, in the frame of the file."""
    assembly = read_step(path)
    whole = ProductGeometry(
        solids=tuple(solid for part in assembly.parts for solid in part.solids),
        faces=assembly.faces,
        edges=assembly.edges,
        mesh=assembly.meshes[0],
    )
    return replace(whole, mesh=_joined("", [replace(whole, mesh=mesh) for mesh in assembly.meshes]))


def _joined(name: str, products: list[ProductGeometry]) -> TriangleMesh:
    """Return the triangles of several products as one mesh."""
    meshes = [product.mesh for product in products]
    firsts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])[:-1]
    return replace(
        meshes[0],
        part=name,
        vertices=np.concatenate([mesh.vertices for mesh in meshes]),
        triangles=np.concatenate([mesh.triangles + first for mesh, first in zip(meshes, firsts, strict=True)]),
        faces=np.concatenate([mesh.faces for mesh in meshes]),
    )


def _part(name: str, placement: Placement) -> CadPart:
    """Return a part with only a name and a placement."""
    return CadPart(
        name=name, product=name, path=(name,), placement=placement, material=None, solids=(), bounds=np.zeros((2, 3))
    )


JOINTS = head(
    *("joint", "journal radius, mm", "c60.toml", "clearance as drawn, mm", "bearing axis off, mm"),
    *("journal axis off, mm", "rings inside", "start gap, mm", "c60.toml"),
)
CONTACTS = head("contact", "start gap, mm", "c60.toml")


def lines(files: Mapping[str, Sequence[Path]]) -> Iterator[str]:
    """Yield the lines of the tables for some files, given by body."""
    mechanism = load_mechanism("c60")
    there = {body: paths for body, paths in files.items() if paths}
    count, listed = (sum(map(len, each.values())) for each in (there, listed_names()))
    yield f"{count} of {listed} listed files: {', '.join(there) or 'none'}"
    if not there:
        return
    assembly = posed_assembly(there, mechanism)
    joints, others = compared_joints(assembly, mechanism)
    yield JOINTS
    for name in mechanism.loose_joints():
        if (joint := joints.get(name)) is None:
            yield f"| {name} | not found | | | | | | | |"
            continue
        radii = [", ".join(f"{radius:g}" for radius in each) for each in (joint.drawn_radii, joint.given_radii)]
        numbers = joint.clearance, joint.bearing_off, joint.journal_off
        yield (
            f"| {name} | {radii[0]} | {radii[1]} | {' | '.join(f'{x:.4f}' for x in numbers)} "
            f"| {'yes' if joint.rings_inside else 'no'} | {joint.drawn_gap:.4f} | {joint.given_gap:.4f} |"
        )
    for pin in others:
        yield f"no joint of c60.toml: a pin of {pin.journal} in {pin.bearing}, radius {pin.seats[0].pin_radius:g} mm"
    yield CONTACTS
    for name, given, drawn in compared_contacts(assembly, mechanism):
        yield f"| {name} | {'not in the files' if drawn is None else f'{drawn:.4f}'} | {given:.4f} |"


def main() -> None:
    """Print the tables of a folder."""
    parser = argparse.ArgumentParser(prog="python -m studies.c60_cad", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--file", action="append", default=[], metavar="BODY=FILE", help="one more file of a body")
    asked = parser.parse_args()
    files = defaultdict(list, listed_files(asked.folder))
    for body, _, name in (entry.partition("=") for entry in asked.file):
        files[body].append(Path(name))
    show(lines(files))


if __name__ == "__main__":
    main()
