"""The circular edges of a shape, including those stored as splines in the file."""

from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Curve
from OCP.GeomAbs import GeomAbs_CurveType
from OCP.gp import gp_Circ
from OCP.ShapeAnalysis import ShapeAnalysis_CanonicalRecognition
from OCP.TopoDS import TopoDS

from engine.cad.merged_arcs import ArcPiece
from engine.cad.occt.occt_arrays import array3, one_way
from engine.cad.occt.shape_maps import EDGE, ShapeMap

_POINTS = 17  # along an arc: less than half a turn between neighbours, even for a full circle
_SPLINES = GeomAbs_CurveType.GeomAbs_BSplineCurve, GeomAbs_CurveType.GeomAbs_BezierCurve


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
