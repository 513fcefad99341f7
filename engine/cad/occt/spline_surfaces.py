"""The B-spline surface of a free-form face."""

from typing import Any

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.BRepBuilderAPI import BRepBuilderAPI_NurbsConvert
from OCP.BRepTools import BRepTools
from OCP.GeomConvert import GeomConvert
from OCP.TopoDS import TopoDS

from engine.arrays import Array
from engine.cad.cad_model import SplineSurface
from engine.cad.occt.occt_arrays import array3


def spline_of(face: Any) -> SplineSurface:
    """Return the surface of a face as a B-spline over the rectangle of parameters that the face needs."""
    whole = TopoDS.Face(BRepBuilderAPI_NurbsConvert(face, True).Shape())
    spline = GeomConvert.SurfaceToBSplineSurface_s(BRep_Tool.Surface_s(whole))
    spline.SetUNotPeriodic()
    spline.SetVNotPeriodic()
    _cut_to(spline, BRepTools.UVBounds_s(whole))
    rows, columns = range(1, spline.NbUPoles() + 1), range(1, spline.NbVPoles() + 1)
    return SplineSurface(
        degrees=(spline.UDegree(), spline.VDegree()),
        knots=(
            _knots(spline.NbUKnots(), spline.UKnot, spline.UMultiplicity),
            _knots(spline.NbVKnots(), spline.VKnot, spline.VMultiplicity),
        ),
        points=np.array([[array3(spline.Pole(i, j)) for j in columns] for i in rows]),
        weights=np.array([[spline.Weight(i, j) for j in columns] for i in rows]),
    )


def _cut_to(spline: Any, bounds: tuple[float, float, float, float]) -> None:
    """Cut a spline to a rectangle of parameters; where the rectangle reaches over its edge, the edge stays."""
    u0, u1, v0, v1 = spline.Bounds()
    low_u, high_u, low_v, high_v = bounds
    spline.Segment(max(u0, low_u), min(u1, high_u), max(v0, low_v), min(v1, high_v))


def _knots(count: int, knot: Any, multiplicity: Any) -> Array:
    """Return the knots of a direction, each as often as its multiplicity."""
    return np.concatenate([[knot(i)] * multiplicity(i) for i in range(1, count + 1)])
