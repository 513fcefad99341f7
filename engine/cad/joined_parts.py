"""Several parts of an assembly as one rigid part: their solids, faces, edges and triangles together."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from engine.cad.cad_model import CadAssembly, CadEdge, CadFace, CadPart, Solid, TriangleMesh


def with_joined_parts(
    assembly: CadAssembly, groups: Mapping[str, Sequence[str]], *, beside: bool = False
) -> CadAssembly:
    """Return an assembly in which each group of parts is one part, at the place of the first part of the group.

    Faces keep their numbers. The frame of such a part is that of the first part in its group. With `beside`, the parts
    stay, and those that are made of them follow at the end.
    """
    member = {part: name for name, parts in groups.items() for part in parts}
    joined = {name: _joined(assembly, name, parts) for name, parts in groups.items()}
    faces = {name: _faces(assembly, name, parts) for name, parts in groups.items()}
    edges = {name: _edges(assembly, name, parts) for name, parts in groups.items()}
    meshes = {name: _mesh(assembly, name, parts) for name, parts in groups.items()}
    if beside:
        return replace(
            assembly,
            parts=(*assembly.parts, *joined.values()),
            faces=(*assembly.faces, *(face for each in faces.values() for face in each)),
            edges=(*assembly.edges, *(edge for each in edges.values() for edge in each)),
            meshes=(*assembly.meshes, *meshes.values()),
        )
    first = {parts[0]: name for name, parts in groups.items()}
    kept = [(part, mesh) for part, mesh in zip(assembly.parts, assembly.meshes, strict=True)]
    rows = [
        (joined[first[part.name]], meshes[first[part.name]]) if part.name in first else (part, mesh)
        for part, mesh in kept
        if part.name in first or part.name not in member
    ]
    return replace(
        assembly,
        parts=tuple(part for part, _ in rows),
        faces=tuple(_of_group(assembly, face, member, groups) for face in assembly.faces),
        edges=tuple(replace(edge, part=member.get(edge.part, edge.part)) for edge in assembly.edges),
        meshes=tuple(mesh for _, mesh in rows),
    )


def _of_group(
    assembly: CadAssembly, face: CadFace, member: Mapping[str, str], groups: Mapping[str, Sequence[str]]
) -> CadFace:
    """Return a face as one of the part that its group becomes."""
    if (name := member.get(face.part)) is None:
        return face
    before = groups[name][: groups[name].index(face.part)]
    solid = face.solid + sum(len(assembly.part(part).solids) for part in before) if face.solid >= 0 else -1
    return replace(face, part=name, solid=solid)


def _joined(assembly: CadAssembly, name: str, parts: Sequence[str]) -> CadPart:
    """Return the part that a group becomes."""
    members = [assembly.part(part) for part in parts]
    bounds = np.array([member.bounds for member in members])
    common = [names[0] for names in zip(*(member.path for member in members), strict=False) if len(set(names)) == 1]
    return CadPart(
        name=name,
        product=name,
        path=tuple(common),
        placement=members[0].placement,
        material=None,
        solids=tuple(solid for member in members for solid in named_solids(member)),
        bounds=np.array([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)]),
    )


def named_solids(part: CadPart) -> list[Solid]:
    """Return the solids of a part with its material and name, as those of a larger part."""
    several = len(part.solids) > 1
    return [
        replace(
            solid,
            name=f"{part.name}, {solid.name or f'solid {number}'}" if several else part.name,
            material=solid.material or part.material,
        )
        for number, solid in enumerate(part.solids)
    ]


def _faces(assembly: CadAssembly, name: str, parts: Sequence[str]) -> list[CadFace]:
    """Return the faces of a group as those of one part."""
    member = dict.fromkeys(parts, name)
    own = [face for part in parts for face in assembly.faces_of(part)]
    return [_of_group(assembly, face, member, {name: parts}) for face in own]


def _edges(assembly: CadAssembly, name: str, parts: Sequence[str]) -> list[CadEdge]:
    """Return the edges of a group as those of one part."""
    return [replace(edge, part=name) for part in parts for edge in assembly.edges if edge.part == part]


def _mesh(assembly: CadAssembly, name: str, parts: Sequence[str]) -> TriangleMesh:
    """Return the triangles of a group as those of one part."""
    by_part = {mesh.part: mesh for mesh in assembly.meshes}
    meshes = [by_part[part] for part in parts]
    firsts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return TriangleMesh(
        part=name,
        vertices=np.concatenate([mesh.vertices for mesh in meshes]),
        triangles=np.concatenate([mesh.triangles + first for mesh, first in zip(meshes, firsts, strict=False)]),
        faces=np.concatenate([mesh.faces for mesh in meshes]),
        deflection=max(mesh.deflection for mesh in meshes),
    )
