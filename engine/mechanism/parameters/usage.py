"""How a mechanism uses its parameters: in which keys and units, or not at all."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from engine.faults.fault import Fault
from engine.mechanism.parameters.expression import ExpressionFault, Node, names_in, parse
from engine.mechanism.parameters.parameter_table import PREFIX, order_of

_KEEPS_THE_UNIT = ("+", "-", "abs", "min", "max", "hypot")
_OF_AN_ANGLE = ("sin", "cos", "tan")


Uses = dict[str, dict[str, str]]
"""Name of a parameter -> unit in which it is used -> one of the keys that use it."""


def parameter_units(formulas: Mapping[str, str], units: Mapping[str, str], *, scaled: bool) -> Uses:
    """Return the units in which each parameter is used, if the expressions show them.

    A parameter on its own or in a sum has the unit of the whole expression; in a sine it is an angle. In products and
    quotients of parameters the unit cannot be known. ``units`` gives the unit of each key that has one and is not a
    parameter. With ``scaled``, a number that multiplies or divides a parameter is assumed to have no unit, which is
    likely but not certain.
    """
    found: Uses = {}
    own = {key.removeprefix(PREFIX): text for key, text in formulas.items() if key.startswith(PREFIX)}
    for key, text in formulas.items():
        if not key.startswith(PREFIX):
            _note(found, key, _units_in(parse(text), units.get(key, ""), scaled))
    for name in reversed(list(order_of(own))):  # what uses a parameter comes first, and gives it its unit
        for unit in found.get(name, ()) or ("",):
            _note(found, PREFIX + name, _units_in(parse(own[name]), unit, scaled))
    return found


def users(formulas: Mapping[str, str]) -> dict[str, list[str]]:
    """Return the keys whose expressions use each parameter, by parameter."""
    found: dict[str, list[str]] = {}
    for key, text in formulas.items():
        for name in dict.fromkeys(names_in(parse(text))):
            found.setdefault(name, []).append(key)
    return found


def conflicting_units(units: Uses, values: Mapping[str, float]) -> Iterator[Fault]:
    """Yield a fault for each parameter that is used in two units; an angle also counts as a pure number."""
    for name, uses in units.items():
        if len(uses) > 1 and uses.keys() != {"1", "rad"}:
            (first, at), (second, there) = list(uses.items())[:2]
            text = f"is in {first} in {at} and in {second} in {there}; allowed: one unit; write two parameters"
            yield Fault(("parameters", name), text, values.get(name))


def unused_parameters(values: Mapping[str, float], formulas: Mapping[str, str], benches: Any) -> Iterator[Fault]:
    """Yield a fault for each parameter that no expression uses, including those in the plain data of test benches."""
    used = {name for text in [*formulas.values(), *_texts(benches)] for name in _names(text)}
    for name, value in values.items():
        if name not in used:
            text = f"is used nowhere; allowed: parameters that are; write {name!r} in place of a number, or remove it"
            yield Fault(("parameters", name), text, value)


def _texts(data: Any) -> Iterator[str]:
    """Yield each text in plain data."""
    if isinstance(data, str):
        yield data
    elif isinstance(data, Mapping | list | tuple):
        for inner in data.values() if isinstance(data, Mapping) else data:
            yield from _texts(inner)


def _names(text: str) -> list[str]:
    """Return the names in a text if it is an expression."""
    try:
        return list(names_in(parse(text)))
    except ExpressionFault:
        return []


def _note(found: Uses, key: str, uses: Iterable[tuple[str, str]]) -> None:
    for name, unit in uses:
        found.setdefault(name, {}).setdefault(unit, key)


def _units_in(node: Node, unit: str, scaled: bool) -> Iterator[tuple[str, str]]:
    """Yield the names in an expression whose unit follows from that of the whole expression, ``""`` if unknown."""
    if isinstance(node, str) and unit:
        yield node, unit
    if not isinstance(node, tuple):
        return
    operation, *operands = node
    for i, operand in enumerate(operands):
        others = [name for j, other in enumerate(operands) if j != i for name in names_in(other)]
        factor = scaled and not others and (operation == "*" or (operation == "/" and i == 0))
        own = "rad" if operation in _OF_AN_ANGLE else unit if operation in _KEEPS_THE_UNIT or factor else ""
        yield from _units_in(operand, own, scaled)
