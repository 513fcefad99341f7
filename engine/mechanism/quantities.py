"""The two consistent unit systems of a mechanism file, and the quantities of its keys and of formulas over responses.

In a formula a sum, a sign, ``abs``, ``min``, ``max`` and ``hypot`` keep the quantity; a factor that is a pure number
does, too. Any other product, quotient, power or root has the quantity that fits its dimensions, if exactly one does.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from pydantic import GetJsonSchemaHandler

from engine.mechanism.expression import ExpressionFault, Node

UnitSystem = Literal["mm-g-ms", "SI"]
Powers = tuple[Fraction | int, Fraction | int, Fraction | int]  # of mass, length and time; an angle is a pure number

# name: units in both systems, and powers; None: a formula cannot have it, as it is not measured in a run
_QUANTITIES: dict[str, tuple[str, str, Powers | None]] = {
    "number": ("1", "1", (0, 0, 0)),
    "angle": ("rad", "rad", (0, 0, 0)),
    "length": ("mm", "m", (0, 1, 0)),
    "per length": ("1/mm", "1/m", (0, -1, 0)),
    "mass": ("g", "kg", (1, 0, 0)),
    "time": ("ms", "s", (0, 0, 1)),
    "frequency": ("1/ms", "Hz", (0, 0, -1)),
    "rate": ("1/ms", "1/s", (0, 0, -1)),
    "angular speed": ("rad/ms", "rad/s", (0, 0, -1)),
    "inertia": ("g mm2", "kg m2", (1, 2, 0)),
    "speed": ("mm/ms", "m/s", (0, 1, -1)),
    "acceleration": ("mm/ms2", "m/s2", (0, 1, -2)),
    "force": ("N", "N", (1, 1, -2)),
    "impulse": ("N ms", "N s", (1, 1, -1)),
    "energy": ("mJ", "J", (1, 2, -2)),
    "torque": ("N mm", "N m", (1, 2, -2)),
    "stiffness": ("N/mm", "N/m", (1, 0, -2)),
    "Hertz stiffness": ("N/mm^1.5", "N/m^1.5", (1, Fraction(-1, 2), -2)),
    "torsional stiffness": ("N mm/rad", "N m/rad", (1, 2, -2)),
    "damping": ("N ms/mm", "N s/m", (1, 0, -1)),
    "torsional damping": ("N mm ms/rad", "N m s/rad", (1, 2, -1)),
    "area": ("mm2", "m2", (0, 2, 0)),
    "second moment of area": ("mm4", "m4", (0, 4, 0)),
    "stress": ("N/mm2", "Pa", (1, -1, -2)),
    "real time": ("s", "s", None),
    "temperature": ("degC", "degC", None),
    "expansion": ("1/K", "1/K", None),
}
if TYPE_CHECKING:
    MeasurableQuantity = str
else:
    MeasurableQuantity = Literal[tuple(name for name, (*_, powers) in _QUANTITIES.items() if powers)]

_PURE = (0, 0, 0)
_KEEP = ("+", "-", "abs", "min", "max", "hypot")
_OF_AN_ANGLE = ("sin", "cos", "tan")
_AN_ANGLE = ("asin", "acos", "atan", "radians")


@dataclass(frozen=True)
class Quantity:
    """The quantity that a number in the file measures; its unit follows from the file's unit system."""

    name: str  # one of those in this module, such as "length" or "torsional stiffness"

    def unit(self, system: UnitSystem) -> str:
        """Return the unit in a unit system; ``"1"`` for a pure number."""
        small, si, _ = _QUANTITIES[self.name]
        return si if system == "SI" else small

    def __get_pydantic_json_schema__(self, schema: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Add the quantity to the JSON Schema, so that an editor can show it."""
        return {**handler(schema), "x-quantity": self.name}


def quantity_with_unit(unit: str, system: UnitSystem) -> Quantity:
    """Return the first quantity that has a unit in a unit system."""
    return next(quantity for name in _QUANTITIES if (quantity := Quantity(name)).unit(system) == unit)


class Measure(NamedTuple):
    """The dimensions of a part of an expression, and its quantity where that is known."""

    powers: Powers
    name: str | None  # None: whichever fits the dimensions
    literal: bool = False  # a number in the expression itself, which in a sum has the quantity of the others


def quantity_of(node: Node, names: Mapping[str, Quantity]) -> Quantity:
    """Return the quantity of an expression, from its tree and the quantities of the names in it.

    Raise ExpressionFault if it adds quantities of two kinds, or if no quantity or several have its dimensions.
    """
    measure = _measure(node, names)
    if measure.name is not None:
        return Quantity(measure.name)
    fitting = _of_powers(measure.powers)
    if measure.powers == _PURE:
        return Quantity("number")
    if len(fitting) != 1:
        what = f"may be: {', '.join(fitting)}" if fitting else "is of no quantity that has a unit here"
        remedy = "say which with quantity = ..." if fitting else "multiply or divide by something else"
        raise ExpressionFault(f"its result {what}; {remedy}")
    return Quantity(fitting[0])


def fits(quantity: Quantity, node: Node, names: Mapping[str, Quantity]) -> bool:
    """Return whether an expression has the dimensions of a quantity; raise ExpressionFault as `quantity_of` does."""
    return _measure(node, names).powers == _QUANTITIES[quantity.name][2]


def _measure(node: Node, names: Mapping[str, Quantity]) -> Measure:
    if isinstance(node, float):
        return Measure(_PURE, "number", literal=True)
    if isinstance(node, str):
        return Measure(_QUANTITIES[names[node].name][2] or _PURE, names[node].name)
    operation, *operands = node
    measures = [_measure(operand, names) for operand in operands]
    if operation in _KEEP:
        return _sum(operation, measures)
    if operation in (*_OF_AN_ANGLE, *_AN_ANGLE):
        if measures[0].powers != _PURE:
            raise ExpressionFault(f"{operation}(...) of {_text(measures[0])}; allowed: a number or an angle")
        return Measure(_PURE, "number" if operation in _OF_AN_ANGLE else "angle")
    if operation == "atan2":
        _sum(operation, measures)
        return Measure(_PURE, "angle")
    if operation == "sqrt":
        return _power(measures[0], Fraction(1, 2))
    if operation == "**":
        return _raised(measures, operands[1])
    return _product(measures, -1 if operation == "/" else 1)


def _sum(operation: str, measures: list[Measure]) -> Measure:
    """Return the measure of numbers of one kind, and refuse those of two."""
    named = [measure for measure in measures if not measure.literal]
    if not named:
        return measures[0]
    for other in named[1:]:
        if other.powers != named[0].powers:
            kinds = f"{_text(named[0])} and {_text(other)}"
            raise ExpressionFault(f"{operation} joins {kinds}; allowed: two of one kind; correct the formula")
    return next((measure for measure in named if measure.name not in (None, "number")), named[0])


def _raised(measures: list[Measure], exponent: Node) -> Measure:
    base = measures[0]
    if base.powers == _PURE:
        return Measure(_PURE, "number", literal=base.literal)
    sign = 1.0
    while isinstance(exponent, tuple) and exponent[0] in ("+", "-") and len(exponent) == 2:
        sign, exponent = (-sign if exponent[0] == "-" else sign), exponent[1]
    if not isinstance(exponent, float):
        raise ExpressionFault(f"{_text(base)} to a power that is not a number; write the exponent as a number")
    return _power(base, Fraction(sign * exponent).limit_denominator(12))


def _power(base: Measure, exponent: Fraction) -> Measure:
    mass, length, time = (power * exponent for power in base.powers)
    name = "number" if base.powers == _PURE else base.name if exponent == 1 else None
    return Measure((mass, length, time), name, base.literal)


def _product(measures: list[Measure], sign: int) -> Measure:
    a, b = measures
    mass, length, time = (first + sign * second for first, second in zip(a.powers, b.powers, strict=True))
    name = None
    if b.name == "number":
        name = a.name
    elif a.name == "number" and sign > 0:
        name = b.name
    elif (mass, length, time) == _PURE:
        name = "number"
    return Measure((mass, length, time), name, a.literal and b.literal)


def _text(measure: Measure) -> str:
    """Return what something measures, in words."""
    if measure.name is not None:
        return f"{'an' if measure.name[0] in 'aei' else 'a'} {measure.name}"
    return " or ".join(_of_powers(measure.powers)) or "a quantity without a unit here"


def _of_powers(powers: Powers) -> list[str]:
    return [name for name, (*_, own) in _QUANTITIES.items() if own == powers]
