"""Convert a product's shape to numbers, once for all its instances: faces, triangles, and circular edges."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Curve
from OCP.GeomAbs import GeomAbs_CurveType
from OCP.gp import gp_Circ
from OCP.ShapeAnalysis import ShapeAnalysis_CanonicalRecognition
from OCP.TopoDS import TopoDS

from engine.arrays import Integers
from engine.cad.cad_model import CadMaterial, ProductGeometry, TriangleMesh
from engine.cad.merged_pieces import ArcPiece, FacePiece, merge_arcs, merge_pieces
from engine.cad.occt.face_pieces import face_piece, triangulate
from engine.cad.occt.mass_properties import solid_properties
from engine.cad.occt.occt_values import EDGE, FACE, SOLID, ShapeMap, array3, one_way

_POINTS = 17  # along an arc: less than half a turn between neighbours, even for a full circle
_SPLINES = GeomAbs_CurveType.GeomAbs_BSplineCurve, GeomAbs_CurveType.GeomAbs_BezierCurve


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


def arc_pieces(shape: Any, faces: Sequence[Any], numbers: Sequence[int], recognition: float) -> list[ArcPiece]:
    """Return the circular edges of a product's shape; `numbers` has -1 for each of its faces that was left out.

    A spline counts as a circle if it is no more than `recognition` [mm] away from one.
    """
    edges = ShapeMap(shape, EDGE)
    bounded: dict[int, set[int]] = defaultdict(set)
    for face, number in zip(faces, numbers, strict=True):
        for edge in ShapeMap(face, EDGE).shapes():
            bounded[edges.place(edge)] |= {number} - {-1}
    found = []
    for place, edge in enumerate(map(TopoDS.Edge, edges.shapes())):
        if not BRep_Tool.Degenerated_s(edge) and (arc := _arc(edge, recognition)):
            found.append(ArcPiece(place=place, faces=tuple(sorted(bounded[place])), **arc))
    return found


def _arc(edge: Any, recognition: float) -> dict[str, Any] | None:
    """Return the circle of an edge and points along the edge; None for any other curve."""
    curve, gap = BRepAdaptor_Curve(edge), 0.0
    if curve.GetType() == GeomAbs_CurveType.GeomAbs_Circle:
        circle = curve.Circle()
    elif curve.GetType() in _SPLINES and recognition > 0:
        circle, tried = gp_Circ(), ShapeAnalysis_CanonicalRecognition(edge)
        if not tried.IsCircle(recognition, circle) or tried.GetGap() > recognition:
            return None
        gap = tried.GetGap()
    else:
        return None
    parameters = np.linspace(curve.FirstParameter(), curve.LastParameter(), _POINTS)
    return {
        "centre": array3(circle.Location()),
        "axis": one_way(array3(circle.Axis().Direction())),
        "radius": circle.Radius(),
        "recognition_gap": gap,
        "points": np.array([array3(curve.Value(float(parameter))) for parameter in parameters]),
    }
