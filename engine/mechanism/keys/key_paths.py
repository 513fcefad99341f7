"""The path of a key through a mechanism: tables, lists and numbers, and the field that declares each.

Also the numbers that a file gives as formulas, and the parameters in them: their values, keys and units.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from functools import cache
from graphlib import CycleError, TopologicalSorter
from typing import Any, NamedTuple

from pydantic.fields import FieldInfo

from engine.errors import Fault
from engine.mechanism.base import (
    Components,
    TableModel,
    declared,
    fields_by_key,
    is_number,
    is_quoted_number,
    item,
    with_item,
    written,
)
from engine.mechanism.expression import (
    CONSTANTS,
    FUNCTIONS,
    NAME,
    ExpressionFault,
    Node,
    evaluate,
    names_in,
    names_in_text,
    parse,
)
from engine.mechanism.faults import MOST_FAULTS, did_you_mean
from engine.mechanism.joints import Joint
from engine.mechanism.loads import TableLaw
from engine.mechanism.quantities import Quantity

LONGEST_NAME = 60  # characters
PREFIX = "parameters."  # of the key of a parameter

_KEEPS_THE_UNIT = ("+", "-", "abs", "min", "max", "hypot")
_OF_AN_ANGLE = ("sin", "cos", "tan")

Uses = dict[str, dict[str, str]]  # name of a parameter -> unit in which it is used -> one of the keys that use it


def parameter_values(table: Mapping[str, Any]) -> tuple[dict[str, float], list[Fault]]:
    """Return the value of each parameter that neither is wrong nor depends on a wrong one, and the table's faults."""
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
    """Return the units in which each parameter is used, from those of the keys that are not parameters.

    A parameter on its own or in a sum has the unit of the whole expression; in a sine it is an angle. In products and
    quotients of parameters it is unknown. With ``scaled``, numbers there count as having none: likely, not certain.
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
    used = {name for text in [*formulas.values(), *_texts(elsewhere)] for name in names_in_text(text)}
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


# Paths.

HIDDEN = ("benches", "presets", "plot", "geometry")  # for other mechanisms, for plots, and the origin of numbers

_OF_A_MOTION = ("mass", "inertia", "center_of_mass", "velocity", "angular_velocity")  # no effect on a fixed body
SETTINGS = "simulation."  # how a run is computed; not properties of the mechanism


class Place(NamedTuple):
    """A value in a mechanism, which may be a table, a dict of tables, a list or a number, and its position."""

    value: Any
    owner: TableModel | None = None  # the table that has this value, or the list with it, under one of its keys
    field: FieldInfo | None = None  # the declaration of that key
    inside: tuple[str, ...] = ()  # tokens of the value within the list that contains it

    def below(self) -> dict[str, "Place"]:
        """Return the places directly below this one, by the tokens of their keys."""
        return {token: place for token in self._tokens() if (place := self.at(token)) is not None}

    def at(self, token: str) -> "Place | None":
        """Return the place below with a given token; None if there is none."""
        value = self.value
        if isinstance(value, TableModel):
            name, field = _fields(type(value)).get(token, ("", None))
            return Place(getattr(value, name), value, field) if name else None
        if isinstance(value, Mapping):
            return Place(value[token]) if token in value else None
        if not isinstance(value, tuple) or token not in self._tokens():
            return None
        if value and isinstance(value[0], TableModel):
            return Place(value[int(token)])
        place = self._components()[token][0]
        return self._replace(value=item(written(value), place), inside=(*self.inside, token))

    def _tokens(self) -> Sequence[str]:
        """Return the tokens of the places below."""
        value = self.value
        if isinstance(value, TableModel):
            return list(_fields(type(value)))
        if isinstance(value, Mapping):
            return list(value)
        if not isinstance(value, tuple):
            return ()
        tables = value and isinstance(value[0], TableModel)
        return [str(i) for i in range(len(value))] if tables else list(self._components())

    def with_below(self, changes: Mapping[str, Any]) -> Any:
        """Return the value with some below it replaced, by token; a table raises ValidationError if it refuses them."""
        value = self.value
        if isinstance(value, TableModel):
            return type(value).model_validate({**value.entries(), **changes})
        if isinstance(value, Mapping):
            return {**value, **changes}
        if value and isinstance(value[0], TableModel):
            return tuple(changes.get(str(i), entry) for i, entry in enumerate(value))
        items, components = written(value), self._components()
        for token, new in changes.items():
            for at in components[token]:
                items = with_item(items, at, new)
        return items

    def quantity(self) -> Quantity | None:
        """Return the quantity that a number measures, if declared."""
        if isinstance(self.owner, TableLaw) and self.inside:
            if self.inside[-1] == "0":
                return None if getattr(self.owner, "over", None) else Quantity(self.owner.over_quantity)
            return Quantity(self.owner.value_quantity)
        return declared(self.field, Quantity)

    def _components(self) -> Mapping[str, tuple[tuple[int, ...], ...]]:
        return components(self.field, written(self.value))


@cache
def _fields(table: type[TableModel]) -> dict[str, tuple[str, FieldInfo]]:
    return {key: named for key, named in fields_by_key(table).items() if key not in HIDDEN}


def components(field: FieldInfo | None, items: Sequence[Any]) -> Mapping[str, tuple[tuple[int, ...], ...]]:
    """Return the name of each component of a list declared by a field, and its places."""
    return (declared(field, Components) or Components()).places(items)


def along(mechanism: TableModel, tokens: Sequence[str]) -> list[Place]:
    """Return the existing places along a path, the mechanism first."""
    places = [Place(mechanism)]
    for token in tokens:
        below = places[-1].at(token)
        if below is None:
            break
        places.append(below)
    return places


def by_tokens(entries: Mapping[str, Any]) -> dict[str, Any]:
    """Return entries with dotted keys as nested dicts by token, with the entries at the leaves."""
    tree: dict[str, Any] = {}
    for key, entry in entries.items():
        *tables, last = key.split(".")
        node = tree
        for token in tables:
            node = node.setdefault(token, {})
        node[last] = entry
    return tree


def numbers(place: Place, prefix: str = "") -> Iterator[tuple[str, Place]]:
    """Yield each number below a place with its key."""
    for token, child in place.below().items():
        if isinstance(child.value, float):
            yield prefix + token, child
        else:
            yield from numbers(child, f"{prefix}{token}.")


def without_effect(mechanism: Any, tokens: Sequence[str]) -> str:
    """Return why a number has no effect, and what to set instead; empty if it has one or does not exist."""
    table, name, *inner = [*tokens, "", ""][: max(len(tokens), 2)]
    joint = mechanism.joints.get(name) if table == "joints" else None
    if isinstance(joint, Joint) and not joint.acts(inner):
        loose = f'write type = "clearance_{joint.type}" into the file first'
        remedy = loose if joint.CLEARANCE else "set another number"
        return f"a {joint.type} joint is ideal and has no play to set; {remedy}"
    if table == "bodies" and inner[:1] == ["outline"]:
        return "an outline is drawn, and has no effect on the motion; set another number"
    body = mechanism.bodies.get(name) if table == "bodies" else None
    if body is not None and body.fixed and inner[:1] and inner[0] in _OF_A_MOTION:
        return f"the body {name} is fixed, and its {inner[0]} has no effect; set its origin, axis or angle"
    return ""


def settable_places(mechanism: TableModel, below: str = "") -> list[tuple[str, Place]]:
    """Return key and place of every number that can be set, in the order of the file; optionally only below a key."""
    start = along(mechanism, below.split(".") if below else ())[-1]
    keys = [(f"{below}.{key}" if below else key, place) for key, place in numbers(start)]
    return [(key, place) for key, place in keys if not without_effect(mechanism, key.split("."))]


# Formulas: a key and the expression that gives its number, such as ``joints.J1.bearing.point.x`` and ``arm / 2``.
# The key of a parameter is ``parameters.NAME``.


def formulas_in(place: Place, data: Any, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Yield key and expression of each number below a place that ``data``, its value in the file, gives as one."""
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
    others = [key for key in formulas if not key.startswith(PREFIX)]
    found: dict[str, set[str]] = {}
    for key in [*(PREFIX + name for name in order_of(own) if name not in origins), *others]:
        needed = names_in(parse(formulas[key]))
        if from_ := set[str]().union(*(origins.get(name, set()) for name in needed)):
            found[key] = from_
            if key.startswith(PREFIX):
                origins[key.removeprefix(PREFIX)] = from_
    return found
