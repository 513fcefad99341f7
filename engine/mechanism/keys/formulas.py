"""The numbers of a mechanism that its file gives as expressions, and their dependence on parameters.

A formula is a key and the expression that gives its number, such as ``joints.J1.bearing.point.x`` and ``arm / 2``. The
key of a parameter is ``parameters.NAME``.
"""

from collections.abc import Collection, Iterator, Mapping
from typing import Any

from engine.mechanism.base import TableModel
from engine.mechanism.components import item, with_item, written
from engine.mechanism.keys.places import Place, by_tokens, components
from engine.mechanism.parameters.expression import names_in, parse
from engine.mechanism.parameters.parameter_table import PREFIX, order_of


def formulas_in(place: Place, data: Any, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Yield key and expression of each number below a place that the file gives as an expression.

    ``data`` is the value at the place as read from the file, and ``prefix`` the key of the place, followed by a dot.
    """
    for token, child in place.below().items():
        read = _read(place, data, token)
        if isinstance(read, str) and isinstance(child.value, float):
            yield prefix + token, read
        elif _holds_text(read):  # skips most tables: they hold only numbers, and many are long
            yield from formulas_in(child, read, f"{prefix}{token}.")


def _holds_text(data: Any) -> bool:
    """Return whether a table or list read from a file contains a text at any depth."""
    if isinstance(data, Mapping):
        data = data.values()
    elif not isinstance(data, list | tuple):
        return False
    return any(isinstance(entry, str) or _holds_text(entry) for entry in data)


def _read(place: Place, data: Any, token: str) -> Any:
    """Return the data in the file under a token of a place; None if there are none."""
    if isinstance(data, Mapping):
        return data.get(token)
    if isinstance(place.value, tuple) and place.value and isinstance(place.value[0], TableModel):
        return data[int(token)]
    at = components(place.field, data).get(token)
    return item(data, at[0]) if at else None


def with_formulas(mechanism: TableModel, formulas: Mapping[str, str], dump: Any) -> Any:
    """Return the dump of a mechanism by the keys of its file, with the expressions instead of their numbers."""
    return _with_formulas(Place(mechanism), dump, by_tokens(formulas))


def _with_formulas(place: Place | None, data: Any, formulas: Any) -> Any:
    """Return dumped data with the expressions of the numbers below a place, by tokens."""
    if isinstance(formulas, str) or place is None:
        return formulas
    if isinstance(data, Mapping):  # some tokens may be missing from the dump
        there = [token for token in formulas if token in data]
        return {**data, **{token: _with_formulas(place.at(token), data[token], formulas[token]) for token in there}}
    for token, inner in formulas.items():
        child = place.at(token)
        of_numbers = child is not None and child.inside
        for at in components(place.field, written(place.value))[token] if of_numbers else ((int(token),),):
            data = with_item(data, at, _with_formulas(child, item(data, at), inner))
    return data


def following(formulas: Mapping[str, str], changed: Collection[str]) -> dict[str, set[str]]:
    """Return the keys whose expressions depend on changed parameters, each with these parameters; parameters first."""
    origins: dict[str, set[str]] = {name: {name} for name in changed}
    own = {key.removeprefix(PREFIX): text for key, text in formulas.items() if key.startswith(PREFIX)}
    found: dict[str, set[str]] = {}
    for name in order_of(own):
        if name not in origins and (from_ := _origins(own[name], origins)):
            origins[name] = found[PREFIX + name] = from_
    for key, text in formulas.items():
        if not key.startswith(PREFIX) and (from_ := _origins(text, origins)):
            found[key] = from_
    return found


def _origins(text: str, origins: Mapping[str, set[str]]) -> set[str]:
    """Return the changed parameters that an expression depends on."""
    return set().union(*(origins.get(name, set()) for name in names_in(parse(text))))
