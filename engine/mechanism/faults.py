"""From what pydantic found to one line for each fault: `table.key = value: what; allowed; remedy`."""

import difflib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from engine.mechanism.base import is_number
from engine.mechanism.quantities import Quantity, UnitSystem

_NOTHING = object()


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong with a mechanism.

    Parameters
    ----------
    key : str
        Dotted path of the key at fault.
    text : str
        What is wrong; what is allowed; what to do.
    value
        What stands there, if anything does.
    unit : str
        Unit of the value, if it is a number that has one.
    """

    key: str
    text: str
    value: Any = _NOTHING
    unit: str = ""

    def __str__(self) -> str:
        if self.value is _NOTHING:
            return f"{self.key}: {self.text}"
        shown = str(self.value).lower() if isinstance(self.value, bool) else repr(self.value)
        unit = f" {self.unit}" if self.unit not in ("", "1") and is_number(self.value) else ""
        return f"{self.key} = {shown if len(shown) <= 80 else shown[:77] + '...'}{unit}: {self.text}"


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return `; did you mean 'x'?` for the closest of ``known``, or nothing when none is close."""
    close = difflib.get_close_matches(word, list(known), n=1, cutoff=0.6)
    return f"; did you mean '{close[0]}'?" if close else ""


def field_quantity(field: FieldInfo) -> Quantity | None:
    """Return the physical quantity a field was declared with."""
    return next((item for item in field.metadata if isinstance(item, Quantity)), None)


def field_of(model: type[BaseModel], key: str) -> FieldInfo | None:
    """Return the field a key of the file names (``from`` is the field ``from_``)."""
    for name, field in model.model_fields.items():
        if key == (field.alias or name):
            return field
    return None


def known_keys(model: type[BaseModel]) -> list[str]:
    """Return the keys a table of the file may have."""
    return [field.alias or name for name, field in model.model_fields.items()]


def faults_of(error: ValidationError, root: type[BaseModel], system: UnitSystem) -> list[Fault]:
    """Translate a validation error.

    Parameters
    ----------
    error : ValidationError
        What pydantic raised.
    root : type
        The model that was validated: where the paths of the error start.
    system : str
        Unit system, to print values with their unit.

    Returns
    -------
    list of Fault
        One for each, in the order of the file.
    """
    return [_fault(details, root, system) for details in error.errors(include_url=False)]


def _fault(details: Mapping[str, Any], root: type[BaseModel], system: UnitSystem) -> Fault:
    """Translate one entry of ``ValidationError.errors()``."""
    kind, context, value = details["type"], details.get("ctx", {}), details["input"]
    path, owner, field = _locate(root, details["loc"])
    quantity = field_quantity(field) if field else None
    unit = quantity.unit(system) if quantity else ""
    key = ".".join(path)
    if kind == "refused":
        below = context.get("key")
        if below:
            value = context["value"] if context["value"] is not None else _NOTHING
            path, _, field = _locate(root, (*details["loc"], *below.split(".")))
            quantity = field_quantity(field) if field else None
            unit = quantity.unit(system) if quantity else ""
        elif isinstance(value, Mapping | BaseModel):
            value = _NOTHING
        return Fault(".".join(path), details["msg"], value, unit)
    if kind == "missing":
        return Fault(key, f"missing; it is {field.description if field else 'required'}; add it")
    if kind == "extra_forbidden":
        known = known_keys(owner) if owner else []
        return Fault(key, f"unknown key; allowed here: {', '.join(known)}{did_you_mean(path[-1], known)}")
    if kind == "union_tag_not_found":
        known = _tags(field.annotation) if field else []
        return Fault(f"{key}.type", f"missing; allowed: {', '.join(known)}; add type = ...")
    if kind == "union_tag_invalid":
        tag = str(context["tag"])
        known = _tags(field.annotation) if field else []
        return Fault(f"{key}.type", f"unknown type; allowed: {', '.join(known)}{did_you_mean(tag, known)}", tag)
    if details["loc"] and details["loc"][-1] == "[key]":
        return Fault(key, "not a usable name; allowed: a letter, then letters, digits, '-', '_'; rename it")
    if isinstance(value, Mapping | BaseModel):
        value = _NOTHING
    return Fault(key, _what(kind, context, field), value, unit)


_BOUNDS = {"greater_than": (">", "gt"), "greater_than_equal": (">=", "ge"), "less_than_equal": ("<=", "le")}


def _what(kind: str, context: Mapping[str, Any], field: FieldInfo | None) -> str:
    """Say what is wrong with a single value, and what it should be."""
    should = f"; give {field.description}" if field and field.description else ""
    if kind in _BOUNDS:
        relation, name = _BOUNDS[kind]
        return f"out of range; allowed: {relation} {context[name]:g}{should}"
    if kind in ("float_type", "finite_number"):
        return f"not a finite number{should}"
    if kind == "literal_error":
        return f"not known; allowed: {context['expected']}{should}"
    if kind in ("model_type", "dict_type"):
        return f"not a table{should}"
    if kind == "string_pattern_mismatch":
        return f"not a usable name; allowed: a letter, then letters, digits, '-', '_'{should}"
    plain = {
        "bool_type": "not true or false",
        "string_type": "not a text",
        "tuple_type": "not a list",
        "too_short": "empty",
    }
    return f"{plain.get(kind, 'not allowed')}{should}"


def _locate(root: type[BaseModel], loc: Sequence[str | int]) -> tuple[list[str], Any, FieldInfo | None]:
    """Follow an error's location through the models.

    Returns the path as the user wrote it (without the tags pydantic adds for a choice between models),
    the model that owns its last key, and that key's field.
    """
    annotation: Any = root
    path: list[str] = []
    owner: type[BaseModel] | None = None
    field: FieldInfo | None = None
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
        known = field.annotation if field else None
        annotation = known if models else _item(options)
    return path, owner, field


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


def _tags(annotation: Any) -> list[str]:
    """Return the values of ``type`` among which the tables of a dict can choose."""
    return [tag for model in _options(_item(_options(annotation))) for tag in _tags_of(model)]


def _tags_of(model: type[BaseModel]) -> tuple[str, ...]:
    """Return by what pydantic tells the model from others: the values of its ``type`` key, or a key only it has."""
    field = model.model_fields.get("type")
    if field is None or get_origin(field.annotation) is not Literal:
        distinguishing_key = getattr(model, "distinguishing_key", None)
        return (distinguishing_key,) if distinguishing_key else ()
    return tuple(map(str, get_args(field.annotation)))
