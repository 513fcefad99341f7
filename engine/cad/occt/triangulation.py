"""Triangles of faces."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from OCP.Bnd import Bnd_Box
from OCP.BRep import BRep_Tool
from OCP.BRepBndLib import BRepBndLib
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.TopAbs import TopAbs_Orientation
from OCP.TopLoc import TopLoc_Location

from engine.arrays import Array, Integers

_SAG = 2e-3  # distance between a triangle and its face, as a share of the size of the shape
_SAG_LIMITS = 1e-3, 0.05  # mm
_TURN = 0.3  # rad between neighbouring triangles


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
