"""Answers to questions about a STEP file, in a child process, because a broken file can crash or block OCCT."""

import json
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from OCP.BRep import BRep_Builder
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeVertex, BRepBuilderAPI_Transform
from OCP.BRepExtrema import BRepExtrema_DistShapeShape
from OCP.gp import gp_Pnt, gp_Trsf
from OCP.TopoDS import TopoDS_Compound

from engine.cad.archive import packed
from engine.cad.occt.occt_values import EDGE, FACE, ShapeMap
from engine.cad.occt.product_tree import instances
from engine.cad.occt.step_assembly import read_assembly
from engine.cad.occt.step_document import UnreadableStep, open_step
from engine.platform.child import Send


def answer(request: bytes, _send: Send) -> bytes:
    """Answer one question about the file at a ``path``, as `engine.cad.step_reader` asks it.

    It has one of two more keys: ``assembly``, a table with the file's ``sha256`` and the largest ``recognition`` gap
    [mm], or ``distances``, a list of pairs of shapes.
    """
    question = json.loads(request)
    path = Path(question["path"])
    if "distances" in question:
        return json.dumps(measure_distances(path, question["distances"])).encode()
    return packed(read_assembly(path, **question["assembly"]))


def measure_distances(path: Path, pairs: Sequence[Sequence[Mapping[str, Any]]]) -> list[float]:
    """Return the distance of each pair of shapes as drawn [mm]; 0 if they touch or overlap.

    A shape has the keys of `engine.cad.step_reader.MeasuredShape`. Raises UnreadableStep if the file is not a STEP
    file or contains no shapes, or if a distance cannot be measured.
    """
    document = open_step(path)
    parts = instances(document.shapes)

    @cache
    def drawn(part: int) -> tuple[Any, list[Any], list[Any]]:
        """Return how a part is placed, and the faces and edges of its product."""
        product, placement, move = parts[part].shape, parts[part].placement, gp_Trsf()
        move.SetValues(*map(float, np.column_stack([placement.matrix, placement.translation]).flat))
        return move, ShapeMap(product, FACE).shapes(), ShapeMap(product, EDGE).shapes()

    def shape(wanted: Mapping[str, Any]) -> Any:
        """Return one end of a distance as a single shape."""
        if wanted["point"]:
            return BRepBuilderAPI_MakeVertex(gp_Pnt(*wanted["point"])).Vertex()
        whole, builder = TopoDS_Compound(), BRep_Builder()
        builder.MakeCompound(whole)
        move, faces, edges = drawn(wanted["part"])
        for piece in (*(faces[place] for place in wanted["faces"]), *(edges[place] for place in wanted["edges"])):
            builder.Add(whole, BRepBuilderAPI_Transform(piece, move, True).Shape())
        return whole

    return [_distance(*map(shape, pair)) for pair in pairs]


def _distance(a: Any, b: Any) -> float:
    """Return the minimum distance of two shapes."""
    measured = BRepExtrema_DistShapeShape(a, b)
    if not measured.IsDone():
        raise UnreadableStep("has faces whose distance OCCT cannot measure; export it again, as AP242 or AP214")
    return float(measured.Value())
