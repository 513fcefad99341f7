"""Convert a mechanism file that names mesh files to one with their convex pieces, and a certificate of each."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from engine.arrays import Array
from engine.errors import Fault
from engine.mechanism.base import is_number
from engine.mechanism.faults import as_table, faults_of, sub_table
from engine.mechanism.geometry.part_bodies import DensityRules
from engine.mechanism.materials import unknown_material
from engine.mechanism.meshes.certificate import MeshCertificate
from engine.mechanism.meshes.decomposition import convex_pieces
from engine.mechanism.meshes.deviation import largest_deviation
from engine.mechanism.meshes.mesh import MOST_CORNERS, MOST_PIECES, MeshFile
from engine.mechanism.meshes.polyhedra import NotSolid
from engine.mechanism.meshes.stl import LARGEST, TriangleMesh, UnfitMesh, closed_mesh, signed_volumes, triangles_of
from engine.mechanism.quantities import UnitSystem
from engine.platform.regular_file import read_regular_file

ENOUGH = 1e-3  # share of a mesh's size: the default of the largest deviation
WEIGHS = ("mass", "center_of_mass", "inertia")
Keys = tuple[str, ...]


class UnresolvedMesh(Exception):
    """A mesh cannot be taken from its file; ``faults`` say why."""

    def __init__(self, faults: list[Fault]) -> None:
        super().__init__(*map(str, faults))
        self.faults = faults


@dataclass(frozen=True)
class _Meshes:
    """Reads the meshes that a file names, each once, and collects faults and certificates."""

    folder: Path
    units: UnitSystem
    faults: list[Fault] = field(default_factory=list)
    certificates: dict[str, Any] = field(default_factory=dict)
    read: dict[str, tuple[TriangleMesh, str]] = field(default_factory=dict)
    made: dict[MeshFile, tuple[list[Any], MeshCertificate]] = field(default_factory=dict)

    def plain(self, data: Mapping[str, Any], keys: Keys = ()) -> dict[str, Any]:
        """Return the tables of a file, or of one of its benches, with pieces and masses for the meshes they name."""
        plain = dict(data)
        for table, made in (("bodies", self._body), ("contacts", self._contact)):
            if isinstance(data.get(table), Mapping):
                plain[table] = {
                    name: made((*keys, table, name), entry) if isinstance(entry, Mapping) else entry
                    for name, entry in data[table].items()
                }
        return plain

    def _contact(self, keys: Keys, contact: Mapping[str, Any]) -> dict[str, Any]:
        plain = dict(contact)
        for side in ("a", "b"):
            if not _names_mesh(contact.get(side)):
                continue
            where = (*keys, side, "mesh")
            if wanted := self._wanted(where, contact[side]["mesh"]):
                try:
                    pieces, certificate = self._pieces(wanted)
                except (UnfitMesh, OSError, ValueError) as error:
                    self._refuse(where, error, wanted)
                    continue
                self.certificates[".".join(where)] = certificate.model_dump()
                plain[side] = {**contact[side], "mesh": {"pieces": pieces}}
                worst = max(certificate.mesh_to_pieces, certificate.pieces_to_mesh)
                if worst > certificate.allowed:
                    text = (
                        f"the surfaces of {wanted.file} and of its {certificate.pieces} pieces are up to {worst:.4g}"
                        f" apart; allowed: up to {certificate.allowed:.4g}, with at most {MOST_PIECES} pieces of"
                        f" {MOST_CORNERS} corners; raise deviation, or leave away what nothing touches"
                    )
                    self.faults.append(Fault((*where, "deviation"), text, wanted.deviation))
        return plain

    def _body(self, keys: Keys, body: Mapping[str, Any]) -> dict[str, Any]:
        """Return the table of a body; mass, centre and inertia are those of its mesh unless the file gives them."""
        if not _names_mesh(body):
            return dict(body)
        where = (*keys, "mesh")
        plain = {key: value for key, value in body.items() if key not in ("mesh", "density")}
        if not (wanted := self._wanted(where, body["mesh"])) or body.get("fixed") is True:
            return plain
        rules = DensityRules(1.0 if self.units == "mm-g-ms" else 1000.0, 1.0 if self.units == "mm-g-ms" else 1e-3)
        try:
            mesh, _ = self._mesh(wanted)
        except (UnfitMesh, OSError, ValueError) as error:
            self._refuse(where, error, wanted)
            return plain
        volume, centre, inertia = solid_of(wanted.scale * mesh.points)
        given: Any = body.get("density")
        density = rules.named(given) if isinstance(given, str) or (is_number(given) and given > 0) else None
        if density is None and given is None and is_number(body.get("mass")):
            density = body["mass"] / volume
        if density is None:
            text = "missing; a mesh has no mass of its own; allowed: a number > 0, or the name of a material; add it"
            if given is not None:
                text = unknown_material(str(given))
            self.faults.append(Fault((*keys, "density"), text, given))
            return plain
        weight = {"mass": density * volume, "center_of_mass": centre.tolist(), "inertia": (density * inertia).tolist()}
        return {**weight, **plain}

    def _wanted(self, keys: Keys, table: Any) -> MeshFile | None:
        try:
            return MeshFile.model_validate(table)
        except ValidationError as error:
            found = faults_of(error, MeshFile, self.units)
            self.faults.extend(replace(fault, keys=(*keys, *fault.keys)) for fault in found)
            return None

    def _refuse(self, keys: Keys, error: Exception, wanted: MeshFile) -> None:
        text = str(error)
        if isinstance(error, OSError):
            text = f"cannot be read ({(error.strerror or text).lower()}); allowed: an STL file; correct the path"
        elif not isinstance(error, UnfitMesh):
            text = "no file has such a name; allowed: the path of an STL file; correct it"
        self.faults.append(Fault((*keys, "file"), text, wanted.file))

    def _mesh(self, wanted: MeshFile) -> tuple[TriangleMesh, str]:
        """Return the mesh of a file in its own unit, and the SHA-256 of its content."""
        if wanted.file not in self.read:
            content = read_regular_file(self.folder / wanted.file, LARGEST)
            mesh = closed_mesh(triangles_of(content))
            self.read[wanted.file] = mesh, hashlib.sha256(content).hexdigest()
        return self.read[wanted.file]

    def _pieces(self, wanted: MeshFile) -> tuple[list[Any], MeshCertificate]:
        """Return the corners of each piece of a mesh, and its certificate."""
        if wanted not in self.made:
            mesh, digest = self._mesh(wanted)
            scaled = replace(mesh, corners=wanted.scale * mesh.corners)
            allowed = wanted.deviation or ENOUGH * scaled.size
            try:
                pieces = convex_pieces(scaled, allowed)
            except NotSolid:
                pieces = []
            if not pieces:
                raise UnfitMesh("has no volume; allowed: a solid; export it again")
            there, back = largest_deviation(scaled.points, pieces)
            certificate = MeshCertificate(
                file=wanted.file,
                sha256=digest,
                triangles=len(mesh.triangles),
                pieces=len(pieces),
                corners=sum(len(piece.hull.corners) for piece in pieces),
                mesh_to_pieces=there,
                pieces_to_mesh=back,
                allowed=allowed,
            )
            self.made[wanted] = [piece.hull.corners.tolist() for piece in pieces], certificate
        return self.made[wanted]


def _names_mesh(table: Any) -> bool:
    return isinstance(table, Mapping) and isinstance(table.get("mesh"), Mapping) and "file" in table["mesh"]


def names_meshes(data: Mapping[str, Any]) -> bool:
    """Return whether the tables of a mechanism file, or of its benches, name mesh files."""
    tables = [data, *map(as_table, sub_table(data, "benches").values())]
    sides = [as_table(c).get(side) for t in tables for c in sub_table(t, "contacts").values() for side in ("a", "b")]
    return any(map(_names_mesh, [*sides, *(body for t in tables for body in sub_table(t, "bodies").values())]))


def with_meshes(data: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return a mechanism file with the meshes that it names as convex pieces, and their certificates in ``meshes``.

    Paths are relative to ``folder``. Raise UnresolvedMesh.
    """
    meshes = _Meshes(folder, "SI" if data.get("units") == "SI" else "mm-g-ms")
    plain = meshes.plain(data)
    if isinstance(data.get("benches"), Mapping):
        benches = data["benches"].items()
        plain["benches"] = {
            name: meshes.plain(bench, ("benches", name)) if isinstance(bench, Mapping) else bench
            for name, bench in benches
        }
    if meshes.faults:
        raise UnresolvedMesh(meshes.faults)
    return {**plain, "meshes": meshes.certificates} if meshes.certificates else plain


def solid_of(points: Array) -> tuple[float, Array, Array]:
    """Return volume, centre and inertia about it, for a density of 1, of what triangles, (n, 3, 3), enclose."""
    middle = points.reshape(-1, 3).mean(axis=0)  # from which nothing is lost to rounding, wherever the mesh lies
    own = points - middle
    parts, sums = signed_volumes(own), own.sum(axis=1)
    volume = float(parts.sum())
    centre = parts @ sums / (4.0 * volume)
    products = np.einsum("i,ikj,ikl->jl", parts, own, own) + np.einsum("i,ij,il->jl", parts, sums, sums)
    spread = products / 20.0 - volume * np.outer(centre, centre)
    return volume, middle + centre, np.trace(spread) * np.eye(3) - spread
