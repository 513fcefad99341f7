"""Dimensions with limits that AP242 attaches to faces (semantic PMI).

OCCT passes on only the magnitudes of deviations; their signs are taken from the file.
"""

from collections.abc import Callable
from typing import Any

from OCP.collections import Sequence_TDF_Label
from OCP.StepBasic import StepBasic_MeasureWithUnit
from OCP.StepRepr import StepRepr_ReprItemAndMeasureWithUnit
from OCP.StepShape import StepShape_ToleranceValue
from OCP.XCAFDimTolObjects import XCAFDimTolObjects_DimensionType as Type
from OCP.XCAFDoc import XCAFDoc_Dimension, XCAFDoc_DimTolTool

from engine.cad.cad_model import SizeLimits
from engine.cad.occt.names_and_materials import listed

_MATCHED_DECIMALS = 9  # of a mm, to which a deviation is matched

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


class DeviationSigns:
    """The deviations of all plus-minus tolerances in a file, by their magnitudes.

    `millimetres` is the file's unit of length. If OCCT wrote the file (`by_occt`), the lower deviation lacks its sign.
    """

    def __init__(self, model: Any, millimetres: float, by_occt: bool) -> None:
        self._found: dict[tuple[float, float], set[tuple[float, float]]] = {}
        for place in range(1, model.NbEntities() + 1):
            entity = model.Value(place)
            if isinstance(entity, StepShape_ToleranceValue):
                bounds = [_measure(bound) for bound in (entity.LowerBound(), entity.UpperBound())]
                if None not in bounds:
                    lower, upper = (bound * millimetres for bound in bounds if bound is not None)
                    lower = -lower if by_occt and lower > 0 else lower
                    self._found.setdefault(_sizes(lower, upper), set()).add((lower, upper))

    def signed(self, lower: float, upper: float) -> tuple[float, float] | None:
        """Return the lower and upper deviation [mm] with these magnitudes; None if their signs are not known."""
        found = self._found.get(_sizes(lower, upper), set())
        signs = {(low > 0, high > 0) for low, high in found}
        return max(found) if len(signs) == 1 else None

    def both_below(self, lower: float) -> tuple[float, float] | None:
        """Return two negative deviations [mm] by the magnitude of the lower one; None if the file has several such."""
        every = set().union(*self._found.values())
        found = {pair for pair in every if pair[1] < 0 and _sizes(*pair)[0] == _sizes(lower, 0.0)[0]}
        return max(found) if len(found) == 1 else None


def _sizes(lower: float, upper: float) -> tuple[float, float]:
    return round(abs(lower), _MATCHED_DECIMALS), round(abs(upper), _MATCHED_DECIMALS)


def _measure(bound: Any) -> float | None:
    """Return the value of a measure in its own unit."""
    if isinstance(bound, StepRepr_ReprItemAndMeasureWithUnit):
        bound = bound.GetMeasureWithUnit()
    return float(bound.ValueComponent()) if isinstance(bound, StepBasic_MeasureWithUnit) else None


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
        limits, instances = _limits(dimension, signs), faces_of_instances([faces_of(at) for at in _referred(label)])
        if limits is None or instances is None:
            unclear += 1
            continue
        nominal, lower, upper = limits
        found += [SizeLimits(kind=kind, nominal=nominal, lower=lower, upper=upper, faces=each) for each in instances]
    return found, unclear


def faces_of_instances(sides: list[list[tuple[int, ...]]]) -> list[tuple[int, ...]] | None:
    """Return the faces on all sides of a dimension, for each instance of its product; none if a side has no faces.

    None if the sides are on products that occur differently often, as the file does not say which belong together.
    """
    counts = {len(side) for side in sides}
    if len(counts - {0}) > 1:
        return None
    faces = [sum(instance, ()) for instance in zip(*sides, strict=True)] if 0 not in counts else []
    return [each for each in faces if each]


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
