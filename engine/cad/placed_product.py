"""Place a product, which is read once in its own frame, as parts in the assembly."""

from dataclasses import dataclass, replace

import numpy as np

from engine.cad.cad_model import CadEdge, CadFace, Placement, Solid, SplineSurface, TriangleMesh


@dataclass(frozen=True, eq=False, kw_only=True)
class ProductGeometry:
    """The components of a product in its own frame; faces are numbered from 0."""

    solids: tuple[Solid, ...]
    faces: tuple[CadFace, ...]
    edges: tuple[CadEdge, ...]
    mesh: TriangleMesh


def placed_product(product: ProductGeometry, part: str, placement: Placement, first_face: int) -> ProductGeometry:
    """Return a product as a part placed in the assembly; `first_face` is the number of its first face there."""
    return ProductGeometry(
        solids=tuple(_solid(solid, placement) for solid in product.solids),
        faces=tuple(replace(_face(f, placement), part=part, number=f.number + first_face) for f in product.faces),
        edges=tuple(_edge(edge, part, placement, first_face) for edge in product.edges),
        mesh=_mesh(product.mesh, part, placement, first_face),
    )


def _solid(solid: Solid, placement: Placement) -> Solid:
    turn = placement.matrix
    return replace(solid, centre=placement.to_assembly(solid.centre), inertia=turn @ solid.inertia @ turn.T)


def _face(face: CadFace, placement: Placement) -> CadFace:
    turn = placement.matrix
    return replace(
        face,
        point=placement.to_assembly(face.point),
        axis=turn @ face.axis,
        middle=turn @ face.middle,
        on=placement.to_assembly(face.on),
        normal=turn @ face.normal,
        splines=tuple(_spline(spline, placement) for spline in face.splines),
    )


def _spline(spline: SplineSurface, placement: Placement) -> SplineSurface:
    placed = replace(spline, points=placement.to_assembly(spline.points))
    return placed.turned_over() if placement.mirrored else placed


def _edge(edge: CadEdge, part: str, placement: Placement, first_face: int) -> CadEdge:
    turn = placement.matrix
    return replace(
        edge,
        part=part,
        faces=tuple(number + first_face for number in edge.faces),
        centre=placement.to_assembly(edge.centre),
        axis=turn @ edge.axis,
        middle=turn @ edge.middle,
    )


def _mesh(mesh: TriangleMesh, part: str, placement: Placement, first_face: int) -> TriangleMesh:
    triangles = mesh.triangles[:, ::-1] if placement.mirrored else mesh.triangles  # outward is counter-clockwise
    return replace(
        mesh,
        part=part,
        vertices=placement.to_assembly(mesh.vertices),
        triangles=np.ascontiguousarray(triangles),
        faces=mesh.faces + first_face,
    )
