"""The surface of a face as B-splines that cover exactly the face, if all its edges run along parameter lines.

The lines on which edges lie divide the parameter plane into cells. No edge passes through a cell, so each cell is
either part of the face or outside it; one spline covers each cell of the face.
"""

from itertools import pairwise
from math import atan2
from typing import Any

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Curve2d
from OCP.BRepClass import BRepClass_FaceClassifier
from OCP.BRepTools import BRepTools
from OCP.Geom import Geom_Plane, Geom_RectangularTrimmedSurface
from OCP.GeomAbs import GeomAbs_CurveType, GeomAbs_SurfaceType
from OCP.GeomConvert import GeomConvert
from OCP.gp import gp_Ax1, gp_Pnt, gp_Pnt2d, gp_Vec
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum, TopAbs_State
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS

from engine.arrays import Array
from engine.cad.cad_model import SplineSurface
from engine.cad.occt.occt_values import array3

Cell = tuple[tuple[float, float], tuple[float, float]]  # the range of a rectangle along u, and along v

_SAMPLES = 33  # of an edge that is not a straight line in the parameter plane
_GRID = 5  # positions along u and along v where derivatives are evaluated
_MOST_CELLS = 400
_ROUNDING = 1e-9  # of a period

_SWEPT = (GeomAbs_SurfaceType.GeomAbs_SurfaceOfExtrusion, GeomAbs_SurfaceType.GeomAbs_SurfaceOfRevolution)
_INEXACT = (GeomAbs_SurfaceType.GeomAbs_OffsetSurface, GeomAbs_SurfaceType.GeomAbs_OtherSurface)
# curves that are not B-splines, not even rational ones: OCCT would approximate them, which takes minutes for wavy ones
_INEXACT_CURVES = (GeomAbs_CurveType.GeomAbs_OffsetCurve, GeomAbs_CurveType.GeomAbs_OtherCurve)


def parameter_cells(face: Any, tolerance: float) -> tuple[Any, list[Cell]]:
    """Return the surface of a face, and the parameter rectangles that make up the face.

    A plane is rotated within itself so that its parameter lines run along an edge. There are no rectangles if an edge
    is further than `tolerance` [mm] from a parameter line, or if there would be too many.
    """
    surface, edges = BRep_Tool.Surface_s(face), _edges(face)
    speeds = _speeds(surface, np.concatenate(edges))
    turn = _turn(surface, edges)
    if turn:
        way = turn if surface.Position().Direct() else -turn
        surface = surface.Rotated(gp_Ax1(surface.Axis().Location(), surface.Axis().Direction()), way)
    there = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])  # to the rotated parameters
    lines = _lines([edge @ there.T for edge in edges], speeds, tolerance)
    if lines is None or (len(lines[0]) - 1) * (len(lines[1]) - 1) > _MOST_CELLS:
        return surface, []
    u0, u1, v0, v1 = surface.Bounds()
    along_u = _within(lines[0], (u0, u1), surface.IsUPeriodic())
    along_v = _within(lines[1], (v0, v1), surface.IsVPeriodic())
    cells = [(u, v) for u in pairwise(along_u) for v in pairwise(along_v)]
    return surface, [cell for cell in cells if _is_inside(face, np.mean(cell, axis=1) @ there)]


def _edges(face: Any) -> list[Array]:
    """Return the parameters of points along each edge of a face, (n, 2); without edges, of its parameter rectangle."""
    edges = []
    explorer = TopExp_Explorer(face, TopAbs_ShapeEnum.TopAbs_EDGE)
    while explorer.More():  # a seam is visited twice, in both of its positions
        curve = BRepAdaptor_Curve2d(TopoDS.Edge(explorer.Current()), face)
        count = 2 if curve.GetType() == GeomAbs_CurveType.GeomAbs_Line else _SAMPLES
        places = [curve.Value(float(t)) for t in np.linspace(curve.FirstParameter(), curve.LastParameter(), count)]
        edges.append(np.array([(place.X(), place.Y()) for place in places]))
        explorer.Next()
    if not edges:
        u0, u1, v0, v1 = BRepTools.UVBounds_s(face)
        corners = np.array([[u0, v0], [u1, v0], [u1, v1], [u0, v1], [u0, v0]])
        edges = [corners[k : k + 2] for k in range(4)]
    return edges


def _speeds(surface: Any, places: Array) -> Array:
    """Return the largest lengths of a surface's derivatives, shape (2,), on a grid over the parameter rectangle."""
    slopes = []
    for u in np.linspace(places[:, 0].min(), places[:, 0].max(), _GRID):
        for v in np.linspace(places[:, 1].min(), places[:, 1].max(), _GRID):
            point, along_u, along_v = gp_Pnt(), gp_Vec(), gp_Vec()
            surface.D1(float(u), float(v), point, along_u, along_v)
            slopes.append((along_u.Magnitude(), along_v.Magnitude()))
    return np.asarray(np.max(slopes, axis=0))


def _turn(surface: Any, edges: list[Array]) -> float:
    """Return the angle that rotates a plane's axes to its longest straight edge; 0 for any other surface."""
    straight = [edge[-1] - edge[0] for edge in edges if len(edge) == 2]
    if not isinstance(surface, Geom_Plane) or not straight:
        return 0.0
    u, v = max(straight, key=lambda way: float(way @ way))
    return atan2(v, u)


def _lines(edges: list[Array], speeds: Array, tolerance: float) -> list[Array] | None:
    """Return the parameters u and v of the lines on which edges lie; None if an edge lies on no such line."""
    found: list[list[float]] = [[], []]
    for edge in edges:
        middle = (edge.min(axis=0) + edge.max(axis=0)) / 2
        off = np.ptp(edge, axis=0) / 2 * speeds
        axis = int(off.argmin())
        if off[axis] > tolerance:
            return None
        found[axis].append(float(middle[axis]))
    if not all(found):
        return None
    distinct = []
    for each, speed in zip(found, speeds, strict=True):  # close ones are replaced by their mean
        values = np.sort(each)
        groups = np.split(values, np.flatnonzero(np.diff(values) > tolerance / speed) + 1)
        distinct.append(np.array([group.mean() for group in groups]))
    return distinct


def _within(cuts: Array, bounds: tuple[float, float], is_periodic: bool) -> list[float]:
    """Return parameters, with those beyond the edge of a surface, or beyond one period, moved there.

    Those that differ from the bounds of a period by rounding become these: OCCT converts no turn of more than it.
    """
    low, high = bounds
    if is_periodic:
        for bound in bounds:
            cuts = np.where(np.abs(cuts - bound) < _ROUNDING * (high - low), bound, cuts)
        cuts = np.minimum(cuts, cuts.min() + high - low)
    else:
        cuts = np.clip(cuts, low, high)
    return list(map(float, np.unique(cuts)))


def _is_inside(face: Any, parameters: Array) -> bool:
    """Return whether a point of a face's surface lies on the face."""
    found = BRepClass_FaceClassifier(face, gp_Pnt2d(*map(float, parameters)), 1e-9)
    return bool(found.State() == TopAbs_State.TopAbs_IN)


def splines_of(face: Any, adaptor: Any, tolerance: float) -> tuple[SplineSurface, ...]:
    """Return B-splines that cover a face.

    There are none if its edges do not run along parameter lines of its surface, up to `tolerance` [mm], or if the
    surface cannot be written exactly as a B-spline, rational or not, for instance an offset of one.
    """
    kind = adaptor.GetType()
    if kind in _INEXACT or (kind in _SWEPT and adaptor.BasisCurve().GetType() in _INEXACT_CURVES):
        return ()
    surface, cells = parameter_cells(face, tolerance)
    turned = face.Orientation() == TopAbs_Orientation.TopAbs_REVERSED
    found = [_spline(surface, cell) for cell in cells]
    return tuple(spline.turned_over() if turned else spline for spline in found)


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
