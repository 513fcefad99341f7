"""The table ``[parameters]``: the value of each parameter, and the keys and units in which a mechanism uses it."""

from collections.abc import Iterable, Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from typing import Any

from engine.faults.fault import Fault
from engine.mechanism.base import is_number, is_quoted_number
from engine.mechanism.expression import (
    CONSTANTS,
    FUNCTIONS,
    NAME,
    ExpressionFault,
    Node,
    evaluate,
    names_in,
    parse,
)
from engine.mechanism.faults import MOST_FAULTS, did_you_mean

LONGEST_NAME = 60  # characters
PREFIX = "parameters."  # of the key of a parameter

_KEEPS_THE_UNIT = ("+", "-", "abs", "min", "max", "hypot")
_OF_AN_ANGLE = ("sin", "cos", "tan")

Uses = dict[str, dict[str, str]]
"""Name of a parameter -> unit in which it is used -> one of the keys that use it."""


def parameter_values(table: Mapping[str, Any]) -> tuple[dict[str, float], list[Fault]]:
    """Return the value of each parameter of a file, and the faults in the table.

    Parameters that are wrong or depend on a wrong one have no value.
    """
    faults: dict[str, str] = {}
    for name, entry in table.items():
        if text := _fault(name, entry, table, suggest=len(faults) < MOST_FAULTS):
            faults[name] = text
    texts = {name: entry for name, entry in table.items() if isinstance(entry, str) and name not in faults}
    values = {name: float(entry) for name, entry in table.items() if is_number(entry) and name not in faults}
    needs = {name: set(names_in(parse(text))) for name, text in texts.items()}
    try:
        order = list(TopologicalSorter(needs).static_order())
    except CycleError as error:
        circle = error.args[1][::-1]
        way = " -> ".join(circle[:10])
        faults[circle[0]] = f"follows from itself: {way}; allowed: no circle; give one of them a number"
        order = []
    for name in order:
        if name in texts and needs[name] <= values.keys():
            try:
                values[name] = evaluate(parse(texts[name]), values)
            except ExpressionFault as fault:
                faults[name] = str(fault)
    values = {name: values[name] for name in table if name in values}
    return values, [Fault(("parameters", name), text, table[name]) for name, text in faults.items()]


def order_of(expressions: Mapping[str, str]) -> Iterator[str]:
    """Yield the parameters that have an expression, each after those it depends on."""
    needs = {name: set(names_in(parse(text))) for name, text in expressions.items()}
    return (name for name in TopologicalSorter(needs).static_order() if name in expressions)


def _fault(name: str, entry: Any, table: Mapping[str, Any], *, suggest: bool) -> str:
    """Return what is wrong with a single parameter; empty if nothing is."""
    if not NAME.fullmatch(name) or len(name) > LONGEST_NAME:
        return "not a usable name; allowed: a letter, then letters, digits, '_', up to 60 of them; rename it"
    if name in CONSTANTS or name in FUNCTIONS:
        return f"{name} has a meaning in expressions; allowed: any other name; rename it"
    if is_number(entry):
        return ""
    if not isinstance(entry, str) or is_quoted_number(entry):
        return 'not a finite number; give a number without quotes, or an expression such as "arm / 2"'
    try:
        unknown = [needed for needed in names_in(parse(entry)) if needed not in table]
    except ExpressionFault as fault:
        return str(fault)
    if not unknown:
        return ""
    meant = did_you_mean(unknown[0], table) if suggest else ""
    return f"{unknown[0]} is not a parameter; define it in [parameters]{meant}"


# How a mechanism uses its parameters: in which keys and units, or not at all.


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


def unused_parameters(values: Mapping[str, float], formulas: Mapping[str, str], elsewhere: Any) -> Iterator[Fault]:
    """Yield a fault for each parameter that no expression uses, including those in other plain data."""
    used = {name for text in [*formulas.values(), *_texts(elsewhere)] for name in _names(text)}
    for name, value in values.items():
        if name not in used:
            text = f"is not used; write {name!r} in place of a number, or remove it"
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
