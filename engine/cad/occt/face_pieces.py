"""The faces of a shape: the surface of each, with splines replaced by simple surfaces where possible."""

from typing import Any

import numpy as np
from OCP.BRepAdaptor import BRepAdaptor_Surface
from OCP.GeomAbs import GeomAbs_SurfaceType as Type
from OCP.gp import gp_Cone, gp_Cylinder, gp_Pln, gp_Pnt, gp_Sphere, gp_Vec
from OCP.ShapeAnalysis import ShapeAnalysis_CanonicalRecognition
from OCP.TopAbs import TopAbs_Orientation
from OCP.TopoDS import TopoDS

from engine.arrays import Array
from engine.cad.cad_model import SplineSurface
from engine.cad.merged_pieces import FacePiece
from engine.cad.occt.face_meshes import COARSEST, FaceMesh, mesh_face
from engine.cad.occt.mass_properties import area
from engine.cad.occt.occt_values import OCCT_ERRORS, array3, one_way
from engine.cad.occt.spline_surfaces import splines_of

_PRECISION = 1e-7  # mm that OCCT neglects


def face_piece(face: Any, solid: int, recognition: float, sag: float, level: int) -> tuple[FacePiece | None, bool]:
    """Return a face with triangles as numbers, None if it has no area; and whether it should have splines, but has not.

    `solid` is the index of its solid in the part, -1 if it has none. A spline is replaced by a plane, cylinder, cone or
    sphere that is no more than `recognition` [mm] away. `sag` and `level` are those of `mesh_face`; at the coarsest a
    spline is not replaced, the face has no splines, and its area is that of its triangles.
    """
    face = TopoDS.Face(face)
    mesh = mesh_face(face, sag, level)
    if mesh is None:
        return None, False
    surface = BRepAdaptor_Surface(face, True)
    on, normal = _inside(face, surface, mesh)
    is_hasty = level == COARSEST
    lies_on = _analytic(surface) or (None if is_hasty else _recognised(face, recognition))
    if lies_on is None:
        lies_on = {"kind": "surface", "point": on, "axis": np.zeros(3)}
    elif lies_on["kind"] == "plane":
        lies_on |= {"point": on, "axis": lies_on["axis"] * np.sign(lies_on["axis"] @ normal)}
    splines: tuple[SplineSurface, ...] = ()
    failed = is_hasty
    if not is_hasty:
        try:
            splines = splines_of(face, surface, max(recognition, _PRECISION))
        except OCCT_ERRORS:
            failed = True
    piece = FacePiece(
        solid=solid,
        area=float(mesh.areas.sum()) if is_hasty else area(face),
        on=on,
        normal=normal,
        splines=splines,
        vertices=mesh.vertices,
        triangles=mesh.triangles,
        **lies_on,
    )
    return piece, failed


def _inside(face: Any, surface: Any, mesh: FaceMesh) -> tuple[Array, Array]:
    """Return a point inside a face, in the middle of its largest triangle, and the outward normal there."""
    u, v = mesh.parameters[mesh.triangles[np.argmax(mesh.areas)]].mean(axis=0)
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
