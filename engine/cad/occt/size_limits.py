"""Dimensions with limits that AP242 attaches to faces (semantic PMI).

OCCT passes on only the magnitudes of deviations; their signs are taken from the file. Of a class such as H7 it passes
on numbers that Python cannot ask for, but can find in its document.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

from OCP.collections import Sequence_TDF_Label
from OCP.StepBasic import StepBasic_MeasureWithUnit
from OCP.StepRepr import StepRepr_ReprItemAndMeasureWithUnit
from OCP.StepShape import StepShape_LimitsAndFits, StepShape_ToleranceValue
from OCP.TDataStd import TDataStd_IntegerArray
from OCP.XCAFDimTolObjects import XCAFDimTolObjects_DimensionFormVariance as Variance
from OCP.XCAFDimTolObjects import XCAFDimTolObjects_DimensionType as Type
from OCP.XCAFDoc import XCAFDoc_Dimension, XCAFDoc_DimTolTool

from engine.cad.cad_model import SizeLimits
from engine.cad.occt.names_and_materials import listed, short_text
from engine.drawing_limits import dimension_limits
from engine.errors import some

_MATCHED_DECIMALS = 9  # of a mm, to which a deviation is matched

_DECIMALS = 12  # of a mm, so that 6.1 + 0.02 gives 6.12
_MOST_TAGS = 30  # of the labels below that of a dimension
_LETTERS = {int(each.value): name.rpartition("_")[2] for name, each in Variance.__members__.items() if each.value}
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


class ToleranceClasses:
    """The classes of ISO 286 in a file, such as H7."""

    def __init__(self, model: Any, by_occt: bool) -> None:
        entities = (model.Value(place) for place in range(1, model.NbEntities() + 1))
        self.stated = [_stated(each) for each in entities if isinstance(each, StepShape_LimitsAndFits)]
        # OCCT writes each grade two too coarse: IT7 as 9
        self._finer = 2 if by_occt else 0

    def of(self, label: Any) -> str:
        """Return the class of a dimension; empty if it has none, or one that OCCT cannot read."""
        for tag in range(1, _MOST_TAGS):
            child = label.FindChild(tag, False)
            if child.IsNull() or not child.IsAttribute(TDataStd_IntegerArray.GetID_s()):
                continue
            numbers = TDataStd_IntegerArray()
            child.FindAttribute(TDataStd_IntegerArray.GetID_s(), numbers)
            if numbers.Length() == len(("is a hole", "letter", "grade")):
                is_hole, letter, grade = (numbers.Value(place) for place in range(numbers.Lower(), numbers.Upper() + 1))
                letters = _LETTERS.get(letter, "")
                letters = letters if is_hole else letters.lower()
                return f"{letters}{self._grade(letters, grade)}"
        return ""

    def _grade(self, letters: str, number: int) -> str:
        """Return a grade; `number` is 0 for IT01 and for what is no number, 1 for IT0, 8 for IT7."""
        if number:
            return str(number - 1 - self._finer)
        found = {re.sub(r"\D", "", grade) for form, grade in self.stated if form == letters}
        return found.pop() if len(found) == 1 else ""


def _stated(entity: Any) -> tuple[str, str]:
    """Return the letters and the grade of a class as the file writes them."""
    return short_text(entity.FormVariance()), short_text(entity.Grade())


def size_limits(
    tool: Any, signs: DeviationSigns, classes: ToleranceClasses, faces_of: Callable[[Any], list[tuple[int, ...]]]
) -> tuple[list[SizeLimits], list[str]]:
    """Return the dimensions of a file that have limits, and cautions about those that are left out.

    `faces_of` returns the numbers of the faces on a label, one tuple per instance of its product.
    """
    found: list[SizeLimits] = []
    unclear, others, not_classes, with_class = 0, 0, list[str](), 0
    for label in listed(tool.GetDimensionLabels):
        dimension = XCAFDoc_Dimension.Set_s(label).GetObject()
        if not dimension:
            continue
        has_limits = dimension.IsDimWithPlusMinusTolerance() or dimension.IsDimWithRange()
        has_class = dimension.IsDimWithClassOfTolerance()
        with_class += has_class
        if not (has_limits or has_class):
            continue
        kind = _KINDS.get(dimension.GetType())
        if not kind:
            others += 1
            continue
        stated = "" if has_limits else classes.of(label)
        limits = _limits(dimension, signs) if has_limits else _limits_of_class(dimension, kind, stated)
        instances = faces_of_instances([faces_of(at) for at in _referred(label)])
        if limits is None and not has_limits:
            not_classes.append(f"{kind} {dimension.GetValue():.9g} {stated or 'of a class'}")
            continue
        if limits is None or instances is None:
            unclear += 1
            continue
        nominal, lower, upper = limits
        whole = SizeLimits(kind=kind, nominal=nominal, lower=lower, upper=upper, tolerance_class=stated)
        found += [replace(whole, faces=each) for each in instances]
    unread = [" ".join(each) for each in classes.stated] if len(classes.stated) > with_class else []
    return found, list(_cautions(unclear, others, not_classes, unread))


def _cautions(unclear: int, others: int, not_classes: list[str], unread: list[str]) -> Iterator[str]:
    """Yield what is said about dimensions that are left out."""
    if unclear:
        yield (
            f"{unclear} dimensions are left out: the file has the same deviations with several signs, or does not say"
            " which instances of their parts belong together; give these limits in the campaign file"
        )
    if others:
        yield f"{others} dimensions with limits are left out: angles, lengths of curves, other than distances"
    if not_classes:
        yield f"{some(not_classes)}: ISO 286 has no such class of a diameter or distance; state the limits themselves"
    if unread:
        yield (
            f"classes of tolerance that OCCT cannot read, among {some(unread)}: the file does not write them as the"
            " standard says, letters and grade apart; give these dimensions in the campaign file"
        )


def _limits_of_class(dimension: Any, kind: str, stated: str) -> tuple[float, float, float] | None:
    """Return the nominal size and the limits [mm] of a class of ISO 286; None if the standard has no such class."""
    nominal = round(dimension.GetValue(), _DECIMALS)
    try:
        return None if "radius" in kind else (nominal, *dimension_limits(f"{nominal:.9f} {stated}"))
    except ValueError:
        return None


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
