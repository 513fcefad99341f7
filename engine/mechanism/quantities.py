"""The two consistent unit systems of a mechanism file, and the physical quantities of its keys."""

from dataclasses import dataclass
from typing import Any, Literal

from pydantic import GetJsonSchemaHandler

UnitSystem = Literal["mm-g-ms", "SI"]

_UNITS: dict[str, tuple[str, str]] = {
    "number": ("1", "1"),
    "length": ("mm", "m"),
    "per length": ("1/mm", "1/m"),
    "mass": ("g", "kg"),
    "time": ("ms", "s"),
    "frequency": ("1/ms", "Hz"),
    "rate": ("1/ms", "1/s"),
    "angle": ("rad", "rad"),
    "inertia": ("g mm2", "kg m2"),
    "speed": ("mm/ms", "m/s"),
    "angular speed": ("rad/ms", "rad/s"),
    "acceleration": ("mm/ms2", "m/s2"),
    "force": ("N", "N"),
    "impulse": ("N ms", "N s"),
    "energy": ("mJ", "J"),
    "torque": ("N mm", "N m"),
    "stiffness": ("N/mm", "N/m"),
    "torsional stiffness": ("N mm/rad", "N m/rad"),
    "damping": ("N ms/mm", "N s/m"),
    "torsional damping": ("N mm ms/rad", "N m s/rad"),
    "real time": ("s", "s"),
    "temperature": ("degC", "degC"),
    "expansion": ("1/K", "1/K"),
}


@dataclass(frozen=True)
class Quantity:
    """The quantity that a number in the file measures; its unit follows from the file's unit system."""

    name: str  # one of those in this module, such as "length" or "torsional stiffness"

    def unit(self, system: UnitSystem) -> str:
        """Return the unit in a unit system; ``"1"`` for a pure number."""
        return _UNITS[self.name][0 if system == "mm-g-ms" else 1]

    def __get_pydantic_json_schema__(self, schema: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Add the quantity to the JSON Schema, so that an editor can show it."""
        return {**handler(schema), "x-quantity": self.name}


def quantity_with_unit(unit: str, system: UnitSystem) -> Quantity:
    """Return the first quantity that has a unit in a unit system."""
    return next(quantity for name in _UNITS if (quantity := Quantity(name)).unit(system) == unit)
