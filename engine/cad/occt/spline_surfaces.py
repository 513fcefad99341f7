"""The B-spline surface of a free-form face."""

from typing import Any

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.BRepTools import BRepTools
from OCP.Geom import Geom_RectangularTrimmedSurface
from OCP.GeomConvert import GeomConvert

from engine.arrays import Array
from engine.cad.cad_model import SplineSurface
from engine.cad.occt.occt_arrays import array3


def spline_of(face: Any) -> SplineSurface:
    """Return the surface of a face as a B-spline over the rectangle of parameters that the face needs."""
    surface = BRep_Tool.Surface_s(face)
    u0, u1, v0, v1 = _rectangle(surface, BRepTools.UVBounds_s(face))
    spline = GeomConvert.SurfaceToBSplineSurface_s(Geom_RectangularTrimmedSurface(surface, u0, u1, v0, v1))
    spline.SetUNotPeriodic()
    spline.SetVNotPeriodic()
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


def _rectangle(surface: Any, bounds: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """Return the parameters that a face needs; where they reach over the edge of its surface, that edge."""
    low_u, high_u, low_v, high_v = bounds
    u0, u1, v0, v1 = surface.Bounds()
    if not surface.IsUPeriodic():
        low_u, high_u = max(u0, low_u), min(u1, high_u)
    if not surface.IsVPeriodic():
        low_v, high_v = max(v0, low_v), min(v1, high_v)
    return low_u, high_u, low_v, high_v


def _knots(count: int, knot: Any, multiplicity: Any) -> Array:
    """Return the knots of a direction, each as often as its multiplicity."""
    return np.concatenate([[knot(i)] * multiplicity(i) for i in range(1, count + 1)])
