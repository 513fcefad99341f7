"""Names and materials of the labels in an XCAF document, and the unit of mass of their densities."""

import re
from typing import Any

from OCP.collections import Sequence_TDF_Label
from OCP.StepBasic import (
    StepBasic_ConversionBasedUnitAndMassUnit,
    StepBasic_DerivedUnit,
    StepBasic_MeasureWithUnit,
    StepBasic_SiPrefix,
    StepBasic_SiUnitAndMassUnit,
)
from OCP.TDataStd import TDataStd_Name, TDataStd_TreeNode
from OCP.XCAFDoc import XCAFDoc, XCAFDoc_Material

from engine.cad.cad_model import CadMaterial
from engine.errors import one_line

_PREFIXES = {
    StepBasic_SiPrefix.StepBasic_spMega: 1e6,
    StepBasic_SiPrefix.StepBasic_spKilo: 1e3,
    StepBasic_SiPrefix.StepBasic_spMilli: 1e-3,
    StepBasic_SiPrefix.StepBasic_spMicro: 1e-6,
}

_LONGEST_NAME, _LONGEST_WORD = 200, 20  # characters
_MADE_UP = re.compile(r"Open CASCADE STEP translator|(SOLID|COMPOUND|SHELL|=>\[)")


def listed(fill: Any, *arguments: Any) -> list[Any]:
    """Return the labels that an OCCT method writes into a sequence, its last argument."""
    found = Sequence_TDF_Label()
    fill(*arguments, found)
    return [found.Value(place) for place in range(1, found.Length() + 1)]


def short_text(text: Any) -> str:
    """Return a text of a file that is a few letters long, such as a class; what is longer is cut off."""
    return one_line(str(text.ToCString()).strip()[:_LONGEST_WORD]) if text else ""


def name_of(label: Any) -> str:
    """Return the name of a label, without terminal control characters; empty if it has none."""
    if not label.IsAttribute(TDataStd_Name.GetID_s()):
        return ""
    name = TDataStd_Name()
    label.FindAttribute(TDataStd_Name.GetID_s(), name)
    return one_line(str(name.Get().ToExtString()).strip()[:_LONGEST_NAME])


def given_name(label: Any) -> str:
    """Return the name of a product or an instance; empty if it has none, or one that OCCT made up when writing it."""
    name = name_of(label)
    return "" if _MADE_UP.match(name) else name


def is_shape_of_product(component: Any) -> bool:
    """Return whether OCCT has made up a component for one of several shapes of a product."""
    return name_of(component).startswith("=>[")


def material_of(label: Any, grams: float) -> CadMaterial | None:
    """Return the material of a part or a solid; None if the file names none.

    `grams` is the unit of mass of the file's densities [g], NaN if it is not known; the density is None then.
    """
    node = TDataStd_TreeNode()
    reference = XCAFDoc.MaterialRefGUID_s()
    if not label.IsAttribute(reference):
        return None
    label.FindAttribute(reference, node)
    target = node.Father().Label()
    if not target.IsAttribute(XCAFDoc_Material.GetID_s()):
        return None
    material = XCAFDoc_Material()
    target.FindAttribute(XCAFDoc_Material.GetID_s(), material)
    name, density = material.GetName(), material.GetDensity() * grams / 1000.0  # from g/cm3
    known = density > 0  # false for NaN, too
    return CadMaterial(name=str(name.ToCString()).strip() if name else "", density=density if known else None)


# The unit of mass of the densities in a STEP file.
#
# OCCT converts the unit of length of a density to cm, but treats every unit of mass as a gram.


def grams_of_densities(model: Any) -> float | None:
    """Return the unit of mass of a file's densities [g]; None if there are several, or an unknown one."""
    found = set()
    for place in range(1, model.NbEntities() + 1):
        entity = model.Value(place)
        if isinstance(entity, StepBasic_DerivedUnit):
            units = [entity.ElementsValue(k).Unit() for k in range(1, entity.NbElements() + 1)]
            found |= {_grams(unit) for unit in units if "MassUnit" in type(unit).__name__}
    if not found:
        return 1.0
    [*known] = found
    return known[0] if len(known) == 1 else None


def _grams(unit: Any) -> float | None:
    """Return a unit of mass in g; None if it is unknown."""
    if isinstance(unit, StepBasic_SiUnitAndMassUnit):
        return _PREFIXES.get(unit.Prefix()) if unit.HasPrefix() else 1.0
    if isinstance(unit, StepBasic_ConversionBasedUnitAndMassUnit):
        factor = unit.ConversionFactor()
        if isinstance(factor, StepBasic_MeasureWithUnit):
            inner = _grams(factor.UnitComponent().Value())
            return None if inner is None else float(factor.ValueComponent()) * inner
    return None
