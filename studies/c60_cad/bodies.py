"""Separate STEP files, each in the frame of a body, as one assembly in the start pose of a mechanism."""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from engine.cad import CadAssembly, CadPart, read_step
from engine.cad.cad_model import Placement, ProductGeometry, TriangleMesh, placed_product
from engine.mechanism import Mechanism


def listed_files(folder: Path) -> dict[str, list[Path]]:
    """Return the authors' files by body, without missing ones."""
    listed = tomllib.loads(Path(__file__).with_name("files.toml").read_text("utf-8"))
    return {body: [folder / name for name in names if (folder / name).is_file()] for body, names in listed.items()}


def count_listed() -> int:
    """Return how many files are listed."""
    return sum(map(len, tomllib.loads(Path(__file__).with_name("files.toml").read_text("utf-8")).values()))


def posed_assembly(files: Mapping[str, Sequence[Path]], mechanism: Mechanism) -> CadAssembly:
    """Return all files, in the frames of their bodies [mm], as one assembly with a part for each body that has a file.

    The mechanism defines the start pose of the bodies. CadError: a file cannot be read.
    """
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
