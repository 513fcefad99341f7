"""The surface of a face as B-splines that cover exactly the face."""

from typing import Any

import numpy as np
from OCP.Geom import Geom_RectangularTrimmedSurface
from OCP.GeomAbs import GeomAbs_CurveType, GeomAbs_SurfaceType
from OCP.GeomConvert import GeomConvert
from OCP.TopAbs import TopAbs_Orientation

from engine.arrays import Array
from engine.cad.cad_model import SplineSurface
from engine.cad.occt.occt_arrays import array3
from engine.cad.occt.parameter_cells import Cell, parameter_cells

_SWEPT = (GeomAbs_SurfaceType.GeomAbs_SurfaceOfExtrusion, GeomAbs_SurfaceType.GeomAbs_SurfaceOfRevolution)
_INEXACT = (GeomAbs_SurfaceType.GeomAbs_OffsetSurface, GeomAbs_SurfaceType.GeomAbs_OtherSurface)
_INEXACT_CURVES = (GeomAbs_CurveType.GeomAbs_OffsetCurve, GeomAbs_CurveType.GeomAbs_OtherCurve)
"""Curves that are not B-splines, not even rational ones: OCCT would approximate them, which takes minutes for wavy
ones.
"""


def splines_of(face: Any, adaptor: Any, tolerance: float) -> tuple[SplineSurface, ...]:
    """Return B-splines that cover a face.

    There are none if its edges do not run along parameter lines of its surface, or if the surface is not a B-spline,
    for instance an offset of one.

    An edge may be up to `tolerance` [mm] away from its parameter line.
    """
    if not _is_a_spline(adaptor):
        return ()
    surface, cells = parameter_cells(face, tolerance)
    turned = face.Orientation() == TopAbs_Orientation.TopAbs_REVERSED
    found = [_spline(surface, cell) for cell in cells]
    return tuple(spline.turned_over() if turned else spline for spline in found)


def _is_a_spline(adaptor: Any) -> bool:
    """Return whether a surface can be written exactly as a B-spline, rational or not."""
    if adaptor.GetType() in _SWEPT:
        return adaptor.BasisCurve().GetType() not in _INEXACT_CURVES
    return adaptor.GetType() not in _INEXACT


def _spline(surface: Any, cell: Cell) -> SplineSurface:
    """Return a parameter rectangle of a surface as a B-spline."""
    piece = Geom_RectangularTrimmedSurface(surface, *cell[0], *cell[1])
    spline = GeomConvert.SurfaceToBSplineSurface_s(piece)
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


def _knots(count: int, knot: Any, multiplicity: Any) -> Array:
    """Return the knots of a direction, each repeated by its multiplicity."""
    return np.concatenate([[knot(i)] * multiplicity(i) for i in range(1, count + 1)])
