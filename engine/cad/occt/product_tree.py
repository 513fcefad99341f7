"""The instances of products in an assembly, each with its path and its placement."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from OCP.gp import gp_Trsf
from OCP.TCollection import TCollection_AsciiString
from OCP.TDF import TDF_Label, TDF_Tool
from OCP.XCAFDoc import XCAFDoc_ShapeTool as ShapeTool

from engine.cad.cad_model import Placement
from engine.cad.occt.names_and_materials import given_name, listed
from engine.cad.occt.occt_values import array3, matrix3
from engine.cad.occt.step_document import UnreadableStep

MOST_INSTANCES = 20_000
_DEEPEST = 100  # nested assemblies


@dataclass(frozen=True)
class Instance:
    """One occurrence of a product in the assembly."""

    label: Any
    """The label of the product in the document."""
    path: tuple[str, ...]
    placement: Placement

    @property
    def entry(self) -> str:
        """OCCT's entry string of the product's label."""
        text = TCollection_AsciiString()
        TDF_Tool.Entry_s(self.label, text)
        return str(text.ToCString())


def instances(shapes: Any) -> list[Instance]:
    """Return all instances of products that are not assemblies, in the order of the file.

    Raises UnreadableStep if there are too many or none, or if one is scaled.
    """
    found: list[Instance] = []
    for root in listed(shapes.GetFreeShapes):
        for instance in _below(root, (given_name(root),), gp_Trsf()):
            found.append(instance)
            if len(found) > MOST_INSTANCES:
                raise UnreadableStep(f"has more than {MOST_INSTANCES} parts")
    if not found:
        raise UnreadableStep("has no shapes; export the solids of the parts")
    return found


def _below(label: Any, path: tuple[str, ...], move: gp_Trsf) -> Iterator[Instance]:
    """Yield the instances in an assembly, or the product itself."""
    if len(path) > _DEEPEST:
        raise UnreadableStep(f"has assemblies inside each other, more than {_DEEPEST} deep")
    if not ShapeTool.IsAssembly_s(label):
        yield Instance(label, path, _placement(move, path))
        return
    for component in listed(ShapeTool.GetComponents_s, label):
        product = TDF_Label()
        if ShapeTool.GetReferredShape_s(component, product):
            here = move.Multiplied(ShapeTool.GetLocation_s(component).Transformation())
            yield from _below(product, (*path, given_name(component) or given_name(product)), here)


def _placement(move: gp_Trsf, path: tuple[str, ...]) -> Placement:
    """Return a transformation as a rotation, a translation and possibly a mirror."""
    if abs(abs(move.ScaleFactor()) - 1) > 1e-9:
        raise UnreadableStep(f"scales the part {'/'.join(path)} by {move.ScaleFactor():g}: a part has one size")
    linear = matrix3(move.VectorialPart())
    mirrored = bool(np.linalg.det(linear) < 0)
    rotation = linear * np.array([1.0, 1.0, -1.0 if mirrored else 1.0])
    return Placement(rotation=rotation, translation=array3(move.TranslationPart()), mirrored=mirrored)
