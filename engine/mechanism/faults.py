"""Translate pydantic's errors into one line per fault: `table.key = value: what; allowed; remedy`.

`locate` finds the position of an error for every file format; each format has its own wording. Tables that may contain
faults are read so that a part of the wrong type counts as empty, and nothing is raised.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from engine.errors import Fault
from engine.mechanism.base import declared, fields_by_key, is_number
from engine.mechanism.closest import closest, recipe_for
from engine.mechanism.quantities import Quantity, UnitSystem

MOST_FAULTS = 50  # listed per file


@dataclass(frozen=True)
class Location:
    """The position of an error in a file."""

    path: tuple[str, ...]  # the keys down to the one at fault, as written by the user
    owner: type[BaseModel] | None  # of the table with the last key; None if that has no fixed keys
    field: FieldInfo | None  # of the last key in the path that has one

    @property
    def known_keys(self) -> list[str]:
        """The keys allowed in the table."""
        return list(fields_by_key(self.owner)) if self.owner else []


def listed(faults: Sequence[Any], count: int) -> list[Any]:
    """Return the first faults out of ``count``, followed by the number of further ones."""
    others = count - MOST_FAULTS
    return list(faults[:MOST_FAULTS]) + ([f"and {others} more; correct these first"] if others > 0 else [])


def did_you_mean(word: str, words: Iterable[str]) -> str:
    """Return `; did you mean 'x'?` for the most likely of ``words`` if any is likely, otherwise an empty text."""
    meant = closest(word, words)
    return f"; did you mean '{meant}'?" if meant else ""


def field_of(model: type[BaseModel], key: str) -> FieldInfo | None:
    """Return the field for a key of the file."""
    return fields_by_key(model)[key][1] if key in fields_by_key(model) else None


def faults_of(error: ValidationError, root: type[BaseModel], system: UnitSystem) -> list[Fault]:
    """Translate a validation error, whose paths start at ``root``: one fault per error, at most `MOST_FAULTS`."""
    return [_fault(details, root, system) for details in error.errors(include_url=False)[:MOST_FAULTS]]


def _fault(details: Mapping[str, Any], root: type[BaseModel], system: UnitSystem) -> Fault:
    """Translate one entry of ``ValidationError.errors()``."""
    kind, context, value = details["type"], details.get("ctx", {}), details["input"]
    below = context.get("key") if kind == "refused" else None  # the key that the validator of a table refused
    at = locate(root, (*details["loc"], *below.split(".")) if below else details["loc"])
    keys, field = at.path, at.field
    if below:
        value = context["value"]
    elif isinstance(value, Mapping | BaseModel):
        value = None
    match kind:
        case "refused":
            return Fault(keys, details["msg"], value, _unit(field, system, value))
        case "missing":
            return Fault(keys, f"missing; it is {field.description if field else 'required'}; add it")
        case "extra_forbidden":
            known = at.known_keys
            remedy = _key_of_outer_table(root, details["loc"]) or did_you_mean(at.path[-1], known)
            remedy = remedy or recipe_for(at.path[-1])
            return Fault(keys, f"unknown key; allowed here: {', '.join(known)}{remedy}")
        case "union_tag_not_found":
            return Fault((*keys, "type"), f"missing; allowed: {', '.join(_tags(field))}; add type = ...")
        case "union_tag_invalid":
            tag, known = str(context["tag"]), _tags(field)
            text = f"unknown type; allowed: {', '.join(known)}{did_you_mean(tag, known) or recipe_for(tag)}"
            return Fault((*keys, "type"), text, tag)
    if details["loc"] and details["loc"][-1] == "[key]":
        return Fault(keys, f"{_PLAIN['string_pattern_mismatch']}; rename it")
    return Fault(keys, _what(kind, context, field), value, _unit(field, system, value))


def _key_of_outer_table(root: type[BaseModel], loc: Sequence[str | int]) -> str:
    """Return `; 'x' is a key of TABLE` if a table around the one of an unknown key has this key."""
    for depth in range(len(loc) - 2, 0, -1):
        outer = locate(root, (*loc[:depth], loc[-1]))
        if outer.owner and outer.field:  # not a name in a table of tables, which may be any
            return f"; '{loc[-1]}' is a key of {'.'.join(outer.path[:-1])}: write it there"
    return ""


def _unit(field: FieldInfo | None, system: UnitSystem, value: Any) -> str:
    """Return the unit of a key's value; empty if it has none or is not a number."""
    quantity = declared(field, Quantity)
    return quantity.unit(system) if quantity and is_number(value) else ""


_BOUNDS = {"greater_than": (">", "gt"), "greater_than_equal": (">=", "ge"), "less_than_equal": ("<=", "le")}
_PLAIN = {
    "float_type": "not a finite number",
    "finite_number": "not a finite number",
    "model_type": "not a table",
    "dict_type": "not a table",
    "string_pattern_mismatch": "not a usable name; allowed: a letter, then letters, digits, '-', '_'",
    "bool_type": "not true or false",
    "string_type": "not a text",
    "tuple_type": "not a list",
    "too_short": "empty",
}


def _what(kind: str, context: Mapping[str, Any], field: FieldInfo | None) -> str:
    """Return what is wrong with a single value and what is allowed."""
    should = f"; give {field.description}" if field and field.description else ""
    if kind in _BOUNDS:
        relation, name = _BOUNDS[kind]
        return f"out of range; allowed: {relation} {context[name]:g}{should}"
    if kind == "literal_error":
        return f"not known; allowed: {context['expected']}{should}"
    return f"{_PLAIN.get(kind, 'not allowed')}{should}"


def locate(root: type[BaseModel], loc: Sequence[str | int]) -> Location:
    """Find the position of an error: ``loc`` is pydantic's path, with the tags that it adds for a choice of models."""
    annotation: Any = root
    path, owner, field = list[str](), None, None
    for token in loc:
        options = _options(annotation)
        models = [o for o in options if isinstance(o, type) and issubclass(o, BaseModel)]
        tagged = [m for m in models if len(options) > 1 and token in (*_tags_of(m), m.__name__)]
        if tagged:
            annotation = tagged[0]
            continue
        if token == "[key]":
            break
        path.append(str(token))
        owner, field = (models[0], field_of(models[0], str(token))) if models else (None, field)
        annotation = (field.annotation if field else None) if models else _item(options)
    return Location(tuple(path), owner, field)


def _options(annotation: Any) -> list[Any]:
    """Return the alternatives of a type, without Annotated and None."""
    origin = get_origin(annotation)
    if origin is Annotated:
        return _options(get_args(annotation)[0])
    if origin is Union or type(annotation).__name__ == "UnionType":
        return [o for part in get_args(annotation) for o in _options(part)]
    return [] if annotation in (None, type(None)) else [annotation]


def _item(options: Sequence[Any]) -> Any:
    """Return the type of the items of a dict or tuple."""
    items = get_args(options[0]) if options else ()
    return (items[-1] if get_origin(options[0]) is dict else items[0]) if items else None


def _tags(field: FieldInfo | None) -> list[str]:
    """Return the values of ``type`` that the tables of a dict can choose from."""
    models = _options(_item(_options(field.annotation))) if field else ()
    return [tag for model in models for tag in _tags_of(model)]


def _tags_of(model: type[BaseModel]) -> tuple[str, ...]:
    """Return pydantic's tags for a model in a choice: the values of its kind key, or the key that only it has."""
    field = model.model_fields.get(getattr(model, "kind_key", ""))
    if field is None or get_origin(field.annotation) is not Literal:
        distinguishing_key = getattr(model, "distinguishing_key", None)
        return (distinguishing_key,) if distinguishing_key else ()
    return tuple(map(str, get_args(field.annotation)))


def as_table(value: Any) -> Mapping[str, Any]:
    """Return ``value`` if it is a table, otherwise an empty one."""
    return value if isinstance(value, Mapping) else {}


def sub_table(data: Any, key: str) -> Mapping[str, Any]:
    """Return the table under ``key``; empty if there is none."""
    return as_table(as_table(data).get(key))


def named_tables(data: Any, key: str) -> dict[str, Mapping[str, Any]]:
    """Return the tables inside the table under ``key`` by name, such as all joints."""
    return {name: as_table(entry) for name, entry in sub_table(data, key).items()}


def list_under(data: Any, key: str) -> Sequence[Any]:
    """Return the list under ``key``; empty if there is none."""
    value = as_table(data).get(key)
    return value if isinstance(value, list | tuple) else ()


def phase_names(data: Mapping[str, Any]) -> list[str]:
    """Return the names of the phases; a file without phases has one, called ``run``."""
    return [str(as_table(phase).get("name")) for phase in list_under(data, "phases")] or ["run"]
