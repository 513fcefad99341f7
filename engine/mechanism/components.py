"""The names of the numbers in a list: x, y, z of a vector, xx, xy, ... of an inertia, otherwise 0, 1, ..."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from types import UnionType
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin

from pydantic.fields import FieldInfo

At = tuple[int, ...]
"""Indices of a number in nested lists."""

Kind = TypeVar("Kind")


class Components:
    """The numbers of a list, named by their indices: 0, 1, ..."""

    def places(self, items: Sequence[Any]) -> Mapping[str, tuple[At, ...]]:
        """Return the places of the number with each name; two places if the list holds it twice."""
        return {str(i): ((i,),) for i in range(len(items))}


class Axes(Components):
    """The components x, y, z of a vector."""

    def places(self, items: Sequence[Any]) -> Mapping[str, tuple[At, ...]]:
        """Return the place of each component."""
        return {"x": ((0,),), "y": ((1,),), "z": ((2,),)}


class Tensor(Components):
    """The components xx, xy, ... of a symmetric tensor; xy also stands for yx. A file may give only the diagonal."""

    def places(self, items: Sequence[Any]) -> Mapping[str, tuple[At, ...]]:
        """Return the places of each component."""
        if not isinstance(items[0], list | tuple):
            return {"xx": ((0,),), "yy": ((1,),), "zz": ((2,),)}
        pairs = combinations_with_replacement(range(3), 2)
        return {"xyz"[i] + "xyz"[j]: tuple({(i, j): None, (j, i): None}) for i, j in pairs}


@dataclass(frozen=True)
class Each:
    """A lower limit of each number in a list, checked by the reader of the list."""

    gt: float


def written(value: Any) -> Any:
    """Return a value as written in the file: for a direction the original vector, otherwise the value itself."""
    return getattr(value, "written", value)


def item(items: Any, at: At) -> Any:
    """Return the item at a place in nested lists."""
    for i in at:
        items = items[i]
    return items


def with_item(items: Any, at: At, new: Any) -> Any:
    """Return nested lists, as tuples, with the item at a place replaced."""
    if not at:
        return new
    return tuple(with_item(part, at[1:], new) if i == at[0] else part for i, part in enumerate(items))


def declared(field: FieldInfo | None, kind: type[Kind]) -> Kind | None:
    """Return the declaration of a given kind, such as a quantity, on a field of a table; None if it has none."""
    return next((found for found in _metadata(field) if isinstance(found, kind)), None) if field else None


def limits(field: FieldInfo | None) -> dict[str, float]:
    """Return the limits of a number by their relation: ``{"gt": 0.0}``, or ``ge``, ``lt``, ``le``."""
    found: dict[str, float] = {}
    for mark in _metadata(field) if field else ():
        for relation in ("gt", "ge", "lt", "le"):
            if hasattr(mark, relation):
                found.setdefault(relation, getattr(mark, relation))
    return found


def _metadata(field: FieldInfo) -> Iterator[Any]:
    """Yield the declarations on a field and on the alternatives of its type."""
    yield from field.metadata
    yield from _metadata_of(field.annotation)


def _metadata_of(annotation: Any) -> Iterator[Any]:
    for part in get_args(annotation) if get_origin(annotation) in (Union, UnionType, Annotated) else ():
        if isinstance(part, FieldInfo):
            yield from part.metadata
        else:
            yield part
            yield from _metadata_of(part)


def holds_numbers(annotation: Any) -> bool:
    """Return whether a type is a number or lists of numbers."""
    if get_origin(annotation) in (Union, UnionType, Annotated, tuple):
        return any(map(holds_numbers, get_args(annotation)))
    return annotation is float
