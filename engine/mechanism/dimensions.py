"""What an expression over responses measures, found from the quantities of the names in it.

A sum, a sign, ``abs``, ``min``, ``max`` and ``hypot`` keep the quantity; a factor that is a pure number does, too. Any
other product, quotient, power or root has the quantity that fits its dimensions, if exactly one does.
"""

from collections.abc import Mapping
from fractions import Fraction
from typing import Literal, NamedTuple

from engine.mechanism.expression import ExpressionFault, Node
from engine.mechanism.quantities import Quantity

Powers = tuple[Fraction, Fraction, Fraction]  # of mass, length and time; an angle is a pure number


MeasurableQuantity = Literal[
    "number",
    "angle",
    "length",
    "per length",
    "mass",
    "time",
    "frequency",
    "rate",
    "angular speed",
    "inertia",
    "speed",
    "acceleration",
    "force",
    "impulse",
    "energy",
    "torque",
    "stiffness",
    "torsional stiffness",
    "damping",
    "torsional damping",
]
"""The quantities that a formula may have; those of real time are not measured in a run."""

_POWERS: dict[str, tuple[int, int, int]] = {
    "number": (0, 0, 0),
    "angle": (0, 0, 0),
    "length": (0, 1, 0),
    "per length": (0, -1, 0),
    "mass": (1, 0, 0),
    "time": (0, 0, 1),
    "frequency": (0, 0, -1),
    "rate": (0, 0, -1),
    "angular speed": (0, 0, -1),
    "inertia": (1, 2, 0),
    "speed": (0, 1, -1),
    "acceleration": (0, 1, -2),
    "force": (1, 1, -2),
    "impulse": (1, 1, -1),
    "energy": (1, 2, -2),
    "torque": (1, 2, -2),
    "stiffness": (1, 0, -2),
    "torsional stiffness": (1, 2, -2),
    "damping": (1, 0, -1),
    "torsional damping": (1, 2, -1),
}
_PURE = (Fraction(0), Fraction(0), Fraction(0))
_KEEP = ("+", "-", "abs", "min", "max", "hypot")
_OF_AN_ANGLE = ("sin", "cos", "tan")
_AN_ANGLE = ("asin", "acos", "atan", "radians")


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
    fitting = [name for name, powers in _POWERS.items() if tuple(map(Fraction, powers)) == measure.powers]
    if measure.powers == _PURE:
        return Quantity("number")
    if len(fitting) != 1:
        what = f"may be: {', '.join(fitting)}" if fitting else "is of no quantity that has a unit here"
        remedy = "say which with quantity = ..." if fitting else "multiply or divide by something else"
        raise ExpressionFault(f"its result {what}; {remedy}")
    return Quantity(fitting[0])


def fits(quantity: Quantity, node: Node, names: Mapping[str, Quantity]) -> bool:
    """Return whether an expression has the dimensions of a quantity; raise ExpressionFault as `quantity_of` does."""
    return _measure(node, names).powers == tuple(map(Fraction, _POWERS[quantity.name]))


def _measure(node: Node, names: Mapping[str, Quantity]) -> Measure:
    if isinstance(node, float):
        return Measure(_PURE, "number", literal=True)
    if isinstance(node, str):
        mass, length, time = map(Fraction, _POWERS[names[node].name])
        return Measure((mass, length, time), names[node].name)
    operation, *operands = node
    measures = [_measure(operand, names) for operand in operands]
    if operation in _KEEP:
        return _sum(operation, measures)
    if operation in _OF_AN_ANGLE or operation in _AN_ANGLE:
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
    names = [name for name, powers in _POWERS.items() if tuple(map(Fraction, powers)) == measure.powers]
    return " or ".join(names) or "a quantity without a unit here"
