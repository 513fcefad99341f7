"""The faces of a shape: the surface of each, with splines replaced by simple surfaces where possible; triangles."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from OCP.Bnd import Bnd_Box
from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Surface
from OCP.BRepBndLib import BRepBndLib
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.GeomAbs import GeomAbs_SurfaceType as Type
from OCP.gp import gp_Cone, gp_Cylinder, gp_Pln, gp_Pnt, gp_Sphere, gp_Vec
from OCP.ShapeAnalysis import ShapeAnalysis_CanonicalRecognition
from OCP.TopAbs import TopAbs_Orientation
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS

from engine.arrays import Array, Integers
from engine.cad.merged_pieces import FacePiece
from engine.cad.occt.mass_properties import area
from engine.cad.occt.occt_values import array3, one_way
from engine.cad.occt.spline_surfaces import splines_of

_SAG = 2e-3  # distance between a triangle and its face, as a share of the size of the shape
_SAG_LIMITS = 1e-3, 0.05  # mm
_TURN = 0.3  # rad between neighbouring triangles

_PRECISION = 1e-7  # mm that OCCT neglects


def face_piece(face: Any, solid: int, recognition: float) -> FacePiece | None:
    """Return a face with triangles as numbers; None if it has no area.

    `solid` is the index of its solid in the part, -1 if it has none. A spline is replaced by a plane, cylinder, cone or
    sphere that is no more than `recognition` [mm] away.
    """
    face = TopoDS.Face(face)
    found = triangles_of(face)
    if found is None:
        return None
    vertices, triangles, parameters = found
    surface = BRepAdaptor_Surface(face, True)
    on, normal = _inside(face, surface, vertices, triangles, parameters)
    lies_on = _analytic(surface) or _recognised(face, recognition)
    if lies_on is None:
        lies_on = {"kind": "surface", "point": on, "axis": np.zeros(3)}
    elif lies_on["kind"] == "plane":
        lies_on |= {"point": on, "axis": lies_on["axis"] * np.sign(lies_on["axis"] @ normal)}
    return FacePiece(
        solid=solid,
        area=area(face),
        on=on,
        normal=normal,
        splines=splines_of(face, surface, max(recognition, _PRECISION)),
        vertices=vertices,
        triangles=triangles,
        **lies_on,
    )


def _inside(face: Any, surface: Any, vertices: Array, triangles: Integers, parameters: Array) -> tuple[Array, Array]:
    """Return a point inside a face, in the middle of its largest triangle, and the outward normal there."""
    corners = vertices[triangles]
    sizes = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    u, v = parameters[triangles[np.argmax(sizes)]].mean(axis=0)
    point, along_u, along_v = gp_Pnt(), gp_Vec(), gp_Vec()
    surface.D1(float(u), float(v), point, along_u, along_v)
    normal = np.cross(array3(along_u), array3(along_v))
    normal /= np.linalg.norm(normal)
    return array3(point), -normal if face.Orientation() == TopAbs_Orientation.TopAbs_REVERSED else normal


def _analytic(surface: Any) -> dict[str, Any] | None:
    """Return the surface of a face as given in the file; None for a spline, an extrusion or a revolution."""
    kind = surface.GetType()
    if kind == Type.GeomAbs_Plane:
        return _plane(surface.Plane())
    if kind == Type.GeomAbs_Cylinder:
        return _cylinder(surface.Cylinder())
    if kind == Type.GeomAbs_Cone:
        return _cone(surface.Cone())
    if kind == Type.GeomAbs_Sphere:
        return _sphere(surface.Sphere())
    if kind == Type.GeomAbs_Torus:
        torus = surface.Torus()
        return {
            "kind": "torus",
            "point": array3(torus.Location()),
            "axis": one_way(array3(torus.Axis().Direction())),
            "radius": torus.MajorRadius(),
            "minor_radius": torus.MinorRadius(),
        }
    return None


def _recognised(face: Any, recognition: float) -> dict[str, Any] | None:
    """Return the simplest surface that can replace a face's own, with the gap between them."""
    if recognition <= 0:
        return None
    for taken_for, test, become in (
        (gp_Pln(), ShapeAnalysis_CanonicalRecognition.IsPlane, _plane),
        (gp_Cylinder(), ShapeAnalysis_CanonicalRecognition.IsCylinder, _cylinder),
        (gp_Cone(), ShapeAnalysis_CanonicalRecognition.IsCone, _cone),
        (gp_Sphere(), ShapeAnalysis_CanonicalRecognition.IsSphere, _sphere),
    ):
        tried = ShapeAnalysis_CanonicalRecognition(face)
        if test(tried, recognition, taken_for) and tried.GetGap() <= recognition:
            return {**become(taken_for), "recognition_gap": tried.GetGap()}
    return None


def _plane(found: Any) -> dict[str, Any]:
    return {"kind": "plane", "axis": array3(found.Axis().Direction())}


def _cylinder(found: Any) -> dict[str, Any]:
    axis = one_way(array3(found.Axis().Direction()))
    return {"kind": "cylinder", "point": array3(found.Location()), "axis": axis, "radius": found.Radius()}


def _cone(found: Any) -> dict[str, Any]:
    """Return a cone with its axis in the direction in which it widens."""
    angle = found.SemiAngle()
    axis = array3(found.Axis().Direction()) * np.copysign(1.0, angle)
    return {
        "kind": "cone",
        "point": array3(found.Location()),
        "axis": axis,
        "radius": found.RefRadius(),
        "half_angle": abs(angle),
    }


def _sphere(found: Any) -> dict[str, Any]:
    return {"kind": "sphere", "point": array3(found.Location()), "axis": np.zeros(3), "radius": found.Radius()}


def triangulate(shape: Any) -> float:
    """Triangulate all faces of a shape; return the requested deflection [mm]."""
    box = Bnd_Box()
    BRepBndLib.Add_s(shape, box, False)
    size = 1.0 if box.IsVoid() else float(box.CornerMin().Distance(box.CornerMax()))
    deflection = float(np.clip(_SAG * size, *_SAG_LIMITS))
    BRepMesh_IncrementalMesh(shape, deflection, False, _TURN, False)
    return deflection


def triangles_of(face: Any) -> tuple[Array, Integers, Array] | None:
    """Return the triangles of a face, if any: vertices (n, 3), rows of them (m, 3), parameters (n, 2).

    The triangles are oriented counter-clockwise as seen from outside.
    """
    where = TopLoc_Location()
    mesh = BRep_Tool.Triangulation_s(face, where)
    if mesh is None or not mesh.NbTriangles():
        return None
    count = range(1, mesh.NbNodes() + 1)
    nodes: Iterable[Any] = map(mesh.Node, count)
    if not where.IsIdentity():
        move = where.Transformation()
        nodes = (node.Transformed(move) for node in nodes)
    vertices = np.array([(node.X(), node.Y(), node.Z()) for node in nodes])
    parameters = np.array([(uv.X(), uv.Y()) for uv in map(mesh.UVNode, count)])
    rows = [
        (each.Value(1), each.Value(2), each.Value(3)) for each in map(mesh.Triangle, range(1, mesh.NbTriangles() + 1))
    ]
    triangles = np.array(rows, np.int64) - 1
    turned = face.Orientation() == TopAbs_Orientation.TopAbs_REVERSED
    return vertices, triangles[:, ::-1] if turned else triangles, parameters
