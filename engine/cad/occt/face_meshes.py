"""The triangles of a face, at several levels of fineness."""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from OCP.Bnd import Bnd_Box
from OCP.BRep import BRep_Tool
from OCP.BRepBndLib import BRepBndLib
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.TopAbs import TopAbs_Orientation
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS

from engine.arrays import Array, Integers

_SAG = 2e-3  # distance between a triangle and its face, as a share of the size of the shape
_SAG_LIMITS = 1e-3, 0.05  # mm
_TURN = 0.3  # rad between neighbouring triangles
_LEVELS = ((1.0, _TURN), (8.0, 2 * _TURN), (40.0, 4 * _TURN))  # sag, as a multiple of the finest, and turn
COARSEST = len(_LEVELS) - 1


class FaceMesh(NamedTuple):
    """The triangles of a face, counter-clockwise as seen from outside."""

    vertices: Array
    """Shape (n, 3)."""
    triangles: Integers
    """Row indices into the vertices, shape (m, 3)."""
    parameters: Array
    """Of the vertices on the face's surface, shape (n, 2)."""

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
    return _triangles_of(TopoDS.Face(face))


def _triangles_of(face: Any) -> FaceMesh | None:
    """Return the triangles of a meshed face; None if there are none."""
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
    return FaceMesh(vertices, triangles[:, ::-1] if turned else triangles, parameters)
