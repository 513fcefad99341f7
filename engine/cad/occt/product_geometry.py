"""Convert a product's shape to numbers, once for all its instances."""

from collections import defaultdict
from dataclasses import replace
from typing import Any

import numpy as np

from engine.arrays import Integers
from engine.cad.cad_model import CadMaterial, TriangleMesh
from engine.cad.merged_arcs import merge_arcs
from engine.cad.merged_faces import FacePiece, merge_pieces
from engine.cad.occt.arc_pieces import arc_pieces
from engine.cad.occt.face_pieces import face_piece
from engine.cad.occt.mass_properties import solid_properties
from engine.cad.occt.shape_maps import FACE, SOLID, ShapeMap
from engine.cad.occt.triangulation import triangulate
from engine.cad.placed_product import ProductGeometry


def product_geometry(
    shape: Any, solids: list[tuple[str, CadMaterial | None]], recognition: float
) -> tuple[ProductGeometry, Integers]:
    """Return the components of a product, and the number of each face of its shape, -1 for one without area.

    `solids` has the name and material of each solid. A spline is replaced by a simple surface or circle that is no more
    than `recognition` [mm] away.
    """
    # before the faces are visited: `face_piece` takes one without triangles for one without area
    deflection = triangulate(shape)
    bodies = ShapeMap(shape, SOLID).shapes()
    faces = ShapeMap(shape, FACE)
    owners = np.full(len(faces), -1)
    for place, body in enumerate(bodies):
        for face in ShapeMap(body, FACE).shapes():
            owners[faces.place(face)] = place
    tried = [face_piece(face, int(owners[i]), recognition) for i, face in enumerate(faces.shapes())]
    pieces = [piece for piece in tried if piece is not None]
    merged, number_of_piece = merge_pieces(pieces, "")
    numbers = np.full(len(tried), -1)
    numbers[[piece is not None for piece in tried]] = number_of_piece
    places: dict[int, list[int]] = defaultdict(list)
    for place, number in enumerate(numbers.tolist()):
        places[number].append(place)
    geometry = ProductGeometry(
        solids=tuple(solid_properties(body, *each) for body, each in zip(bodies, solids, strict=True)),
        faces=tuple(replace(face, places=tuple(places[face.number])) for face in merged),
        edges=tuple(merge_arcs(arc_pieces(shape, faces.shapes(), numbers.tolist(), recognition), "")),
        mesh=_mesh(pieces, number_of_piece, deflection),
    )
    return geometry, numbers


def _mesh(pieces: list[FacePiece], numbers: Integers, deflection: float) -> TriangleMesh:
    """Return the triangles of all pieces, each with the number of its face."""
    firsts = np.cumsum([0, *(len(piece.vertices) for piece in pieces)])[:-1]
    return TriangleMesh(
        part="",
        vertices=np.concatenate([np.zeros((0, 3)), *(piece.vertices for piece in pieces)]),
        triangles=np.concatenate(
            [np.zeros((0, 3), np.int64), *(p.triangles + first for p, first in zip(pieces, firsts, strict=True))]
        ),
        faces=np.repeat(numbers, [len(piece.triangles) for piece in pieces]),
        deflection=deflection,
    )
