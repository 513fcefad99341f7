"""Places in a mechanism: a table, a list or a number, the field that declares it, and the places below it."""

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

from pydantic.fields import FieldInfo

from engine.mechanism.base import TableModel
from engine.mechanism.components import Components, declared, item, with_item, written
from engine.mechanism.joints import Joint
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
            return Quantity("time" if self.inside[-1] == "0" else self.owner.value_quantity)
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
