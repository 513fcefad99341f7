"""The path of a key through a mechanism: tables, lists and numbers, the field that declares each, and formulas."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

from pydantic.fields import FieldInfo

from engine.mechanism.base import TableModel
from engine.mechanism.components import Components, declared, item, with_item, written
from engine.mechanism.expression import names_in, parse
from engine.mechanism.joints import Joint
from engine.mechanism.parameters import PREFIX, order_of
from engine.mechanism.quantities import Quantity
from engine.mechanism.time_laws import TableLaw

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
        """Return the value with some of the values below it replaced, by token.

        A table is checked, and raises ValidationError if it refuses the change.
        """
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
    """Return name and declaration of each field of a table by its key in the file, without fields that have no keys."""
    keys = {field.alias or name: (name, field) for name, field in table.model_fields.items()}
    return {key: named for key, named in keys.items() if key not in HIDDEN}


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


# The numbers of a mechanism that its file gives as expressions, and their dependence on parameters.
#
# A formula is a key and the expression that gives its number, such as ``joints.J1.bearing.point.x`` and ``arm / 2``.
# The key of a parameter is ``parameters.NAME``.


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
