"""The faces of a shape: the surface of each, with splines replaced by simple surfaces where possible, and triangles."""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from OCP.Bnd import Bnd_Box
from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Surface
from OCP.BRepBndLib import BRepBndLib
from OCP.BRepGProp import BRepGProp
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.GeomAbs import GeomAbs_SurfaceType as Type
from OCP.gp import gp_Cone, gp_Cylinder, gp_Pln, gp_Pnt, gp_Sphere, gp_Vec
from OCP.GProp import GProp_GProps
from OCP.ShapeAnalysis import ShapeAnalysis_CanonicalRecognition as Recognition
from OCP.TopAbs import TopAbs_Orientation
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS

from engine.arrays import Array, Integers
from engine.cad.cad_model import CadFace, SplineSurface
from engine.cad.merged_pieces import FacePiece
from engine.cad.occt.occt_values import OCCT_ERRORS, array3, one_way
from engine.cad.occt.spline_surfaces import splines_of

_SAG = 2e-3  # distance between a triangle and its face, as a share of the size of the shape
_SAG_LIMITS = 1e-3, 0.05  # mm
_TURN = 0.3  # rad between neighbouring triangles
_LEVELS = ((1.0, _TURN), (8.0, 2 * _TURN), (40.0, 4 * _TURN))  # sag, as a multiple of the finest, and turn
COARSEST = len(_LEVELS) - 1


class FaceMesh(NamedTuple):
    """The triangles of a face, counter-clockwise as seen from outside."""

    vertices: Array  # shape (n, 3)
    triangles: Integers  # row indices into the vertices, shape (m, 3)
    parameters: Array  # of the vertices on the face's surface, shape (n, 2)

    @property
    def areas(self) -> Array:
        """The area of each triangle, shape (m,)."""
        corners = self.vertices[self.triangles]
        doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return np.asarray(np.linalg.norm(doubled, axis=1) / 2)


def usual_sag(shape: Any) -> float:
    """Return the distance of triangles from their faces that suits the size of a shape [mm]."""
    box = Bnd_Box()
    BRepBndLib.Add_s(shape, box, False)
    size = 1.0 if box.IsVoid() else float(box.CornerMin().Distance(box.CornerMax()))
    return float(np.clip(_SAG * size, *_SAG_LIMITS))


def mesh_face(face: Any, sag: float, level: int) -> FaceMesh | None:
    """Return the triangles of a face; None if it has no area. Level 0 is the finest, `COARSEST` the last."""
    times, turn = _LEVELS[level]
    mesher = BRepMesh_IncrementalMesh()
    mesher.SetShape(face)
    parameters = mesher.ChangeParameters()
    parameters.Deflection, parameters.Angle = times * sag, turn
    # the last try keeps only to the edges
    parameters.ControlSurfaceDeflection = level < COARSEST
    mesher.Perform()
    face, where = TopoDS.Face(face), TopLoc_Location()
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
    rows = map(mesh.Triangle, range(1, mesh.NbTriangles() + 1))
    triangles = np.array([(row.Value(1), row.Value(2), row.Value(3)) for row in rows], np.int64) - 1
    turned = face.Orientation() == TopAbs_Orientation.TopAbs_REVERSED
    return FaceMesh(vertices, triangles[:, ::-1] if turned else triangles, parameters)


_PRECISION = 1e-7  # mm that OCCT neglects
_AREA_ERROR = 1e-10  # of an area


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
    try:
        splines = () if is_hasty else splines_of(face, surface, max(recognition, _PRECISION))
    except OCCT_ERRORS:
        failed = True
    size = float(mesh.areas.sum()) if is_hasty else _area(face)
    piece = CadFace(number=-1, part="", solid=solid, area=size, on=on, normal=normal, splines=splines, **lies_on)
    return FacePiece(piece, mesh.vertices, mesh.triangles), failed


def _area(face: Any) -> float:
    """Return the area of a face [mm2], accurate to some percent if its B-spline has inner knots."""
    found = GProp_GProps()
    BRepGProp.SurfaceProperties_s(face, found, _AREA_ERROR, False)
    return float(found.Mass())


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
    given = {
        Type.GeomAbs_Plane: (surface.Plane, _plane),
        Type.GeomAbs_Cylinder: (surface.Cylinder, _cylinder),
        Type.GeomAbs_Cone: (surface.Cone, _cone),
        Type.GeomAbs_Sphere: (surface.Sphere, _sphere),
        Type.GeomAbs_Torus: (surface.Torus, _torus),
    }.get(surface.GetType())
    return given[1](given[0]()) if given else None


def _recognised(face: Any, recognition: float) -> dict[str, Any] | None:
    """Return the simplest surface that can replace a face's own, with the gap between them."""
    if recognition <= 0:
        return None
    for taken_for, test, become in (
        (gp_Pln(), Recognition.IsPlane, _plane),
        (gp_Cylinder(), Recognition.IsCylinder, _cylinder),
        (gp_Cone(), Recognition.IsCone, _cone),
        (gp_Sphere(), Recognition.IsSphere, _sphere),
    ):
        tried = Recognition(face)
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
    angle, point = found.SemiAngle(), array3(found.Location())
    axis = array3(found.Axis().Direction()) * np.copysign(1.0, angle)
    return {"kind": "cone", "point": point, "axis": axis, "radius": found.RefRadius(), "half_angle": abs(angle)}


def _sphere(found: Any) -> dict[str, Any]:
    return {"kind": "sphere", "point": array3(found.Location()), "axis": np.zeros(3), "radius": found.Radius()}


def _torus(found: Any) -> dict[str, Any]:
    axis, radii = one_way(array3(found.Axis().Direction())), (found.MajorRadius(), found.MinorRadius())
    point = array3(found.Location())
    return {"kind": "torus", "point": point, "axis": axis, "radius": radii[0], "minor_radius": radii[1]}
