"""Solids with free-form faces, made by OCCT from control points and closed forms."""

import numpy as np
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge, BRepBuilderAPI_MakeFace, BRepBuilderAPI_MakeWire
from OCP.BRepPrimAPI import BRepPrimAPI_MakePrism
from OCP.collections import Array1_double, Array1_int, Array2_gp_Pnt
from OCP.Geom import Geom_BSplineSurface, Geom_Ellipse
from OCP.GeomConvert import GeomConvert
from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt, gp_Vec


def spline_surface(control, degree, knots):
    """Return a B-spline surface from a net of control points, two degrees and two knot vectors."""
    control = np.array(control)
    poles = Array2_gp_Pnt(1, control.shape[0], 1, control.shape[1])
    for i, row in enumerate(control, 1):
        for j, point in enumerate(row, 1):
            poles.SetValue(i, j, gp_Pnt(*point))
    arrays = []
    for vector in knots:
        values, counts = np.unique(vector, return_counts=True)
        one, other = Array1_double(1, len(values)), Array1_int(1, len(values))
        for k, (value, count) in enumerate(zip(values, counts, strict=True), 1):
            one.SetValue(k, float(value))
            other.SetValue(k, int(count))
        arrays.append((one, other))
    (u, mu), (v, mv) = arrays
    return Geom_BSplineSurface(poles, u, v, mu, mv, *degree, False, False)


def standing_on(surface, height):
    """Return the solid between a surface, as its top, and its copy below."""
    face = BRepBuilderAPI_MakeFace(surface, 1e-7).Face()
    return BRepPrimAPI_MakePrism(face, gp_Vec(0.0, 0.0, -height)).Shape()


def parabolic_bowl(radius=10.0, half=6.0, height=4.0):
    """Return a block whose top is z = (x^2 + y^2) / (2 radius) over a square of sides 2 half."""
    t, rise = np.array([-half, 0.0, half]), half**2 / (2 * radius) * np.array([1.0, -1.0, 1.0])
    control = [[(x, y, a + b) for y, b in zip(t, rise, strict=True)] for x, a in zip(t, rise, strict=True)]
    quarter = [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]
    return standing_on(spline_surface(control, (2, 2), (quarter, quarter)), height)


def elliptic_cam(a, b, width):
    """Return a disc cam with the outline of an ellipse, written as a rational B-spline, about the z axis."""
    ellipse = GeomConvert.CurveToBSplineCurve_s(Geom_Ellipse(gp_Ax2(gp_Pnt(0, 0, 0), gp_Dir(0, 0, 1)), a, b))
    wire = BRepBuilderAPI_MakeWire(BRepBuilderAPI_MakeEdge(ellipse).Edge()).Wire()
    return BRepPrimAPI_MakePrism(BRepBuilderAPI_MakeFace(wire, True).Face(), gp_Vec(0.0, 0.0, width)).Shape()
