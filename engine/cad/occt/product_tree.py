"""The instances of products in an assembly, each with its path and its placement."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from OCP.gp import gp_Trsf
from OCP.TCollection import TCollection_AsciiString
from OCP.TDF import TDF_Label, TDF_Tool
from OCP.TopLoc import TopLoc_Location
from OCP.XCAFDoc import XCAFDoc_ShapeTool as ShapeTool

from engine.cad.cad_model import Placement
from engine.cad.occt.names_and_materials import given_name, is_shape_of_product, listed
from engine.cad.occt.occt_values import FACE, SOLID, ShapeMap, array3, matrix3
from engine.cad.occt.step_document import UnreadableStep

MOST_INSTANCES = 20_000
_DEEPEST = 100  # nested assemblies


@dataclass(frozen=True)
class Instance:
    """One occurrence of a product in the assembly."""

    label: Any  # the label of the product in the document
    name: str  # of the product; empty if it has none
    path: tuple[str, ...]
    placement: Placement
    branch: tuple[int, ...] = ()  # index in each assembly around it, from the root
    solid: int = -1  # index of the solid of the product that it is; -1 if it is all of the product

    @property
    def entry(self) -> tuple[str, int]:
        """OCCT's entry string of the product's label, and the index of the solid."""
        text = TCollection_AsciiString()
        TDF_Tool.Entry_s(self.label, text)
        return str(text.ToCString()), self.solid

    @property
    def shape(self) -> Any:
        """The shape in the frame of the product."""
        # without its location: the placement already has that of all assemblies around it
        whole = ShapeTool.GetShape_s(self.label).Located(TopLoc_Location())
        return whole if self.solid < 0 else ShapeMap(whole, SOLID).shapes()[self.solid]


def instances(shapes: Any) -> list[Instance]:
    """Return all instances of products that are not assemblies, in the order of the file.

    Those without faces, such as datum curves, do not count. If there is one only, each of its solids is an instance.
    Raises UnreadableStep if there are too many or none, or if one is scaled.
    """
    found: list[Instance] = []
    for number, root in enumerate(listed(shapes.GetFreeShapes)):
        for instance in _below(root, given_name(root), (given_name(root),), (number,), gp_Trsf()):
            if not ShapeMap(ShapeTool.GetShape_s(instance.label), FACE):
                continue
            found.append(instance)
            if len(found) > MOST_INSTANCES:
                raise UnreadableStep(f"has more than {MOST_INSTANCES} parts")
    if not found:
        raise UnreadableStep("has no shapes; export the solids of the parts")
    return _solids_of(found[0]) if len(found) == 1 else found


def _solids_of(instance: Instance) -> list[Instance]:
    """Return each solid of an instance as one of its own; the instance itself if it has no more than one."""
    names = [given_name(label) if label is not None else "" for label in labels_of_solids(instance)]
    each = [replace(instance, name=name or instance.name, solid=place) for place, name in enumerate(names)]
    return each if len(each) > 1 else [instance]


def labels_of_solids(instance: Instance) -> list[Any]:
    """Return the label of each solid of an instance; None where it has none of its own."""
    solids = ShapeMap(instance.shape, SOLID)
    found: list[Any] = [None] * len(solids)
    for label in listed(ShapeTool.GetSubShapes_s, instance.label):
        if (place := solids.place(ShapeTool.GetShape_s(label))) >= 0:
            found[place] = label
    return found


def _below(label: Any, name: str, path: tuple[str, ...], branch: tuple[int, ...], move: gp_Trsf) -> Iterator[Instance]:
    """Yield the instances in an assembly, or the product itself."""
    if len(path) > _DEEPEST:
        raise UnreadableStep(f"has assemblies inside each other, more than {_DEEPEST} deep")
    if not ShapeTool.IsAssembly_s(label):
        yield Instance(label, name, path, _placement(move, path), branch)
        return
    components = list[tuple[Any, Any]]()
    for component in listed(ShapeTool.GetComponents_s, label):
        product = TDF_Label()
        if ShapeTool.GetReferredShape_s(component, product):
            components.append((component, product))
    # several shapes of one product, such as a solid and datum curves, are components that OCCT has named
    is_product = all(is_shape_of_product(component) and not given_name(product) for component, product in components)
    for number, (component, product) in enumerate(components):
        here = move.Multiplied(ShapeTool.GetLocation_s(component).Transformation())
        if is_product:
            yield from _below(product, name, path, branch, here)
        else:
            own = given_name(product)
            yield from _below(product, own, (*path, given_name(component) or own), (*branch, number), here)


def _placement(move: gp_Trsf, path: tuple[str, ...]) -> Placement:
    """Return a transformation as a rotation, a translation and possibly a mirror."""
    if abs(abs(move.ScaleFactor()) - 1) > 1e-9:
        raise UnreadableStep(f"scales the part {'/'.join(path)} by {move.ScaleFactor():g}: a part has one size")
    linear = matrix3(move.VectorialPart())
    mirrored = bool(np.linalg.det(linear) < 0)
    rotation = linear * np.array([1.0, 1.0, -1.0 if mirrored else 1.0])
    return Placement(rotation=rotation, translation=array3(move.TranslationPart()), mirrored=mirrored)
