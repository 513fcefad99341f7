"""The unit of mass of the densities in a STEP file.

OCCT converts the unit of length of a density to cm, but treats every unit of mass as a gram.
"""

from typing import Any

from OCP.StepBasic import (
    StepBasic_ConversionBasedUnitAndMassUnit,
    StepBasic_DerivedUnit,
    StepBasic_MeasureWithUnit,
    StepBasic_SiPrefix,
    StepBasic_SiUnitAndMassUnit,
)

_PREFIXES = {
    StepBasic_SiPrefix.StepBasic_spMega: 1e6,
    StepBasic_SiPrefix.StepBasic_spKilo: 1e3,
    StepBasic_SiPrefix.StepBasic_spMilli: 1e-3,
    StepBasic_SiPrefix.StepBasic_spMicro: 1e-6,
}


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
