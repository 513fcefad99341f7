"""Dimensions with limits that AP242 attaches to faces (semantic PMI)."""

from collections.abc import Callable
from typing import Any

from OCP.collections import Sequence_TDF_Label
from OCP.XCAFDimTolObjects import XCAFDimTolObjects_DimensionType as Type
from OCP.XCAFDoc import XCAFDoc_Dimension, XCAFDoc_DimTolTool

from engine.cad.cad_model import SizeLimits
from engine.cad.occt.deviation_signs import DeviationSigns
from engine.cad.occt.document_labels import listed

_DECIMALS = 12  # of a mm, so that 6.1 + 0.02 gives 6.12
_KINDS = {
    Type.XCAFDimTolObjects_DimensionType_Size_Diameter: "diameter",
    Type.XCAFDimTolObjects_DimensionType_Size_SphericalDiameter: "spherical diameter",
    Type.XCAFDimTolObjects_DimensionType_Size_Radius: "radius",
    Type.XCAFDimTolObjects_DimensionType_Size_SphericalRadius: "spherical radius",
    Type.XCAFDimTolObjects_DimensionType_Size_Thickness: "thickness",
    Type.XCAFDimTolObjects_DimensionType_Location_LinearDistance: "linear distance",
    Type.XCAFDimTolObjects_DimensionType_Location_LinearDistance_FromOuterToOuter: "linear distance",
    Type.XCAFDimTolObjects_DimensionType_Location_LinearDistance_FromInnerToInner: "linear distance",
}


def size_limits(
    tool: Any, signs: DeviationSigns, faces_of: Callable[[Any], list[tuple[int, ...]]]
) -> tuple[list[SizeLimits], int]:
    """Return the dimensions of a file that have limits, and the number of those that are unclear.

    `faces_of` returns the numbers of the faces on a label, one tuple per instance of its product.
    """
    found, unclear = [], 0
    for label in listed(tool.GetDimensionLabels):
        dimension = XCAFDoc_Dimension.Set_s(label).GetObject()
        kind = dimension and _KINDS.get(dimension.GetType())
        if not kind or not (dimension.IsDimWithPlusMinusTolerance() or dimension.IsDimWithRange()):
            continue
        limits = _limits(dimension, signs)
        if limits is None:
            unclear += 1
            continue
        nominal, lower, upper = limits
        for instance in zip(*(faces_of(at) for at in _referred(label)), strict=False):
            faces = tuple(number for side in instance for number in side)
            found.append(SizeLimits(kind=kind, nominal=nominal, lower=lower, upper=upper, faces=faces))
    return [each for each in found if each.faces], unclear


def _referred(label: Any) -> list[Any]:
    """Return the labels of the shapes on both sides of a dimension."""
    first, second = Sequence_TDF_Label(), Sequence_TDF_Label()
    XCAFDoc_DimTolTool.GetRefShapeLabel_s(label, first, second)
    return [side.Value(place) for side in (first, second) for place in range(1, side.Length() + 1)]


def _limits(dimension: Any, signs: DeviationSigns) -> tuple[float, float, float] | None:
    """Return the nominal size and both limits [mm]; None if the signs of the deviations are not known."""
    nominal, *others = dimension.GetValues()
    if dimension.IsDimWithRange() and others[0] >= nominal:
        return (nominal + others[0]) / 2, nominal, others[0]
    # OCCT omits a negative upper deviation, so that the size and the lower deviation look like a range
    deviations = signs.signed(*others) if len(others) == 2 else signs.both_below(*others)
    if deviations is None:
        return None
    lower, upper = (round(nominal + each, _DECIMALS) for each in deviations)
    return nominal, lower, upper
