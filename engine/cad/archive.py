"""Store dataclasses of numbers in one file: a tree in JSON, and the arrays it refers to, in NumPy's format (npz)."""

import io
import json
import zipfile
from dataclasses import fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

_T = TypeVar("_T")
_TREE = "tree"


def packed(value: Any) -> bytes:
    """Return a dataclass of numbers, texts, arrays, tuples and nested dataclasses as the content of a file."""
    arrays: list[Any] = []
    tree = json.dumps(_tree(value, arrays)).encode()
    named: dict[str, Any] = {str(place): array for place, array in enumerate(arrays)}
    named[_TREE] = np.frombuffer(tree, np.uint8)
    file = io.BytesIO()
    np.savez(file, **named)
    return file.getvalue()


def unpacked(kind: type[_T], content: bytes) -> _T:
    """Return the dataclass that `packed` wrote; raise ValueError if the content is damaged or of another class."""
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        tree = json.loads(arrays.pop(_TREE).tobytes())
        value: _T = _value(kind, tree, arrays)
    except (KeyError, TypeError, ValueError, AttributeError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise ValueError(f"not a {kind.__name__}: {error}") from error
    return value


def _tree(value: Any, arrays: list[Any]) -> Any:
    """Return a value as JSON; an array becomes its index among the arrays, a dataclass the list of its fields."""
    if is_dataclass(value):
        return [_tree(getattr(value, field.name), arrays) for field in fields(value)]
    if isinstance(value, tuple):
        return [_tree(entry, arrays) for entry in value]
    if isinstance(value, np.ndarray):
        arrays.append(value)
        return len(arrays) - 1
    return value


def _value(kind: Any, tree: Any, arrays: dict[str, Any]) -> Any:
    """Return a value of a given type from its JSON."""
    if isinstance(kind, UnionType):
        [kind] = [NoneType] if tree is None else [each for each in get_args(kind) if each is not NoneType]
    if isinstance(kind, type) and is_dataclass(kind):
        each = zip(_field_kinds(kind).items(), tree, strict=True)
        return kind(**{name: _value(inner, entry, arrays) for (name, inner), entry in each})
    if get_origin(kind) is tuple:
        inner = get_args(kind)
        inner = inner[:1] * len(tree) if inner[-1] is Ellipsis else inner
        return tuple(_value(each, entry, arrays) for each, entry in zip(inner, tree, strict=True))
    return arrays[str(tree)] if _is_array(kind) else tree


def _is_array(kind: Any) -> bool:
    """Return whether a type is one of arrays; since NumPy 2.5, `numpy.typing.NDArray` is the name of such a type."""
    return get_origin(getattr(get_origin(kind), "__value__", kind)) is np.ndarray


@cache
def _field_kinds(kind: Any) -> dict[str, Any]:
    """Return the types of a dataclass's fields by name, in order."""
    hints = get_type_hints(kind)
    return {field.name: hints[field.name] for field in fields(kind)}
