"""The signs of deviations in a STEP file: OCCT passes on only their magnitudes."""

from typing import Any

from OCP.StepBasic import StepBasic_MeasureWithUnit
from OCP.StepRepr import StepRepr_ReprItemAndMeasureWithUnit
from OCP.StepShape import StepShape_ToleranceValue

_DECIMALS = 9  # of a mm, to which a deviation is matched


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
    return round(abs(lower), _DECIMALS), round(abs(upper), _DECIMALS)


def _measure(bound: Any) -> float | None:
    """Return the value of a measure in its own unit."""
    if isinstance(bound, StepRepr_ReprItemAndMeasureWithUnit):
        bound = bound.GetMeasureWithUnit()
    return float(bound.ValueComponent()) if isinstance(bound, StepBasic_MeasureWithUnit) else None
