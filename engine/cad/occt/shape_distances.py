"""Distances between faces, edges and points of an assembly as drawn."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

from OCP.BRep import BRep_Builder
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeVertex, BRepBuilderAPI_Transform
from OCP.BRepExtrema import BRepExtrema_DistShapeShape
from OCP.gp import gp_Pnt, gp_Trsf
from OCP.TopoDS import TopoDS_Compound

from engine.cad.occt.occt_values import EDGE, FACE, ShapeMap
from engine.cad.occt.product_tree import Instance, instances
from engine.cad.occt.step_document import UnreadableStep, open_step


def measure_distances(path: Path, pairs: Sequence[Sequence[Mapping[str, Any]]]) -> list[float]:
    """Return the distance of each pair of shapes [mm]; 0 if they touch or overlap.

    A shape has the keys of `engine.cad.step_reader.MeasuredShape`. Raises UnreadableStep if the file is not a STEP
    file or contains no shapes, or if a distance cannot be measured.
    """
    document = open_step(path)
    parts = [_PlacedPart(instance) for instance in instances(document.shapes)]
    return [_distance(*(_shape(each, parts) for each in pair)) for pair in pairs]


class _PlacedPart:
    """A part as placed in the assembly; its faces and edges by their indices in the product."""

    def __init__(self, instance: Instance) -> None:
        self._product = instance.shape
        placement, self._move = instance.placement, gp_Trsf()
        rows = [[*row, shift] for row, shift in zip(placement.matrix, placement.translation, strict=True)]
        self._move.SetValues(*(float(number) for row in rows for number in row))

    @cached_property
    def _faces(self) -> list[Any]:
        return ShapeMap(self._product, FACE).shapes()

    @cached_property
    def _edges(self) -> list[Any]:
        return ShapeMap(self._product, EDGE).shapes()

    def pieces(self, faces: Sequence[int], edges: Sequence[int]) -> list[Any]:
        """Return some of its faces and edges as placed in the assembly."""
        own = [*(self._faces[place] for place in faces), *(self._edges[place] for place in edges)]
        return [BRepBuilderAPI_Transform(piece, self._move, True).Shape() for piece in own]


def _shape(wanted: Mapping[str, Any], parts: Sequence[_PlacedPart]) -> Any:
    """Return one end of a distance as a single shape."""
    if wanted["point"]:
        return BRepBuilderAPI_MakeVertex(gp_Pnt(*wanted["point"])).Vertex()
    whole, builder = TopoDS_Compound(), BRep_Builder()
    builder.MakeCompound(whole)
    for piece in parts[wanted["part"]].pieces(wanted["faces"], wanted["edges"]):
        builder.Add(whole, piece)
    return whole


def _distance(a: Any, b: Any) -> float:
    """Return the minimum distance of two shapes."""
    measured = BRepExtrema_DistShapeShape(a, b)
    if not measured.IsDone():
        raise UnreadableStep("has faces whose distance OCCT cannot measure; export it again, as AP242 or AP214")
    return float(measured.Value())
