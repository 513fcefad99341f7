"""The table ``[parameters]``: the value of each parameter, from a number or an expression over other parameters."""

from collections.abc import Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from typing import Any

from engine.faults.fault import Fault
from engine.mechanism.base import is_number, is_quoted_number
from engine.mechanism.faults import MOST_FAULTS, did_you_mean
from engine.mechanism.parameters.expression import (
    CONSTANTS,
    FUNCTIONS,
    NAME,
    ExpressionFault,
    evaluate,
    names_in,
    parse,
)

LONGEST_NAME = 60  # characters
PREFIX = "parameters."  # of the key of a parameter


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
