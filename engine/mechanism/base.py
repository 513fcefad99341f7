"""Building blocks of the tables in the file formats: the base class of their models, numbers, vectors and names.

The numbers of a list have names: x, y, z of a vector, xx, xy, ... of an inertia, otherwise 0, 1, ...
"""

import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations_with_replacement
from types import UnionType
from typing import Annotated, Any, ClassVar, Self, TypeVar, Union, get_args, get_origin

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    PlainSerializer,
    StringConstraints,
    ValidationError,
    ValidationInfo,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic_core import InitErrorDetails, PydanticCustomError

from engine.mechanism.expression import ExpressionFault, evaluate, parse
from engine.mechanism.quantities import Quantity

At = tuple[int, ...]  # indices of a number in nested lists
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

    gt: float | None = None
    ge: float | None = None


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
            if getattr(mark, relation, None) is not None:
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


# Tables and the values in them.

LARGEST_NUMBER = 1e100  # in a file, so that squares and products of such numbers are finite
SMALLEST_NUMBER = 1e-100  # of numbers used as divisors
PERPENDICULAR = 1e-5  # largest cosine of the angle between two directions that should be perpendicular


class TableModel(BaseModel):
    """Base class of every table in a file that a user writes: immutable, and an unknown key is an error.

    Where a file offers a choice of tables, the value of the key ``kind_key`` selects one. The magnitude of each number
    is at most `LARGEST_NUMBER`, and at least ``smallest`` unless it is 0.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)

    kind_key: ClassVar[str] = "type"
    smallest: ClassVar[float] = 0.0

    @model_validator(mode="before")
    @classmethod
    def _expressions_become_numbers(cls, data: Any, info: ValidationInfo) -> Any:
        """Replace expressions by their values in the keys that hold numbers, if the file may have parameters."""
        if info.context is None or not isinstance(data, Mapping):
            return data
        numbers: dict[str, Any] = {}
        refused: list[InitErrorDetails] = []
        for key in sorted(_number_keys(cls) & data.keys()):
            try:
                numbers[key] = with_numbers(data[key], info.context)
            except PydanticCustomError as error:
                refused.append(InitErrorDetails(type=error, loc=(key,), input=data[key]))
        if refused:
            raise ValidationError.from_exception_data(cls.__name__, refused)
        return {**data, **numbers}

    @model_validator(mode="after")
    def _numbers_have_a_real_size(self) -> Self:
        smallest = self.smallest
        for name, value in self.__dict__.items():  # written for speed: this runs for every sample
            for number in _numbers(value) if isinstance(value, tuple | dict) else (value,):
                if isinstance(number, float) and number and not smallest <= abs(number) <= LARGEST_NUMBER:
                    sizes = f"0, and sizes from {smallest:g} to" if smallest else "sizes up to"
                    text = f"implausible for a physical quantity; allowed: {sizes} {LARGEST_NUMBER:g}; correct it"
                    key = next(key for key, (own, _) in fields_by_key(type(self)).items() if own == name)
                    raise refuse(text, key=key, value=number)
        return self

    def entries(self) -> dict[str, Any]:
        """Return the table by the keys used in the file (``from``, not ``from_``); its sub-tables remain models."""
        return {key: getattr(self, name) for key, (name, _) in fields_by_key(type(self)).items()}


def optional(description: str, **declared: Any) -> Any:
    """Declare a key that need not be given; its value is then None."""
    return Field(default=None, description=description, **declared)


def added(description: str, **declared: Any) -> Any:
    """Declare an optional key of a later version; not given, it is left out of digests, so that earlier ones stay."""
    return optional(description, exclude_if=lambda value: value is None, **declared)


def refuse(text: str, *, key: str = "", value: Any = None) -> PydanticCustomError:
    """Return a validator's error: what is wrong; what is allowed; what to do. ``key``, dotted, is inside the table."""
    return PydanticCustomError("refused", "{text}", {"text": text, "key": key, "value": value})


@cache
def fields_by_key(model: type[BaseModel]) -> dict[str, tuple[str, FieldInfo]]:
    """Return name and declaration of each field of a table by its key in the file (``from`` is the field ``from_``)."""
    return {field.alias or name: (name, field) for name, field in model.model_fields.items()}


@cache
def _number_keys(model: type[BaseModel]) -> frozenset[str]:
    """Return the keys of a table that hold a number or lists of numbers."""
    return frozenset(key for key, (_, field) in fields_by_key(model).items() if holds_numbers(field.annotation))


def with_numbers(value: Any, parameters: Mapping[str, float], key: str = "") -> Any:
    """Return a value from a file with each expression, but no number in quotes, replaced by its number, also in lists.

    ``key`` is the position within the enclosing lists. Raise the error of `refuse` if an expression has no value.
    """
    if isinstance(value, list | tuple):
        return [with_numbers(item, parameters, f"{key}.{i}" if key else str(i)) for i, item in enumerate(value)]
    if not isinstance(value, str) or is_quoted_number(value):
        return value
    try:
        return evaluate(parse(value), parameters)
    except ExpressionFault as fault:
        raise refuse(str(fault), key=key, value=value) from None


def is_quoted_number(text: str) -> bool:
    """Return whether a text is a plain number, which should be written in the file without quotes."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def _numbers(value: Any) -> Iterator[float]:
    """Yield the floats in an entry of a table; a nested table checks its own."""
    items = value.values() if isinstance(value, dict) else value if isinstance(value, tuple) else (value,)
    for item in items:
        if isinstance(item, float):
            yield item
        elif isinstance(item, tuple | dict):
            yield from _numbers(item)


def one_of(**keys: str) -> Discriminator:
    """Return the discriminator for a choice of tables by the key that only one has: its tag, `distinguishing_key`."""

    def tag_of(value: Any) -> str | None:
        entries = value.entries() if isinstance(value, TableModel) else value if isinstance(value, Mapping) else {}
        given = [key for key in keys if key in entries]
        return given[0] if len(given) == 1 else None

    meanings = ", ".join(f"{key} ({meaning})" for key, meaning in keys.items())
    text = f"which kind is meant? allowed: exactly one of {meanings}; keep or add one"
    return Discriminator(tag_of, custom_error_type="refused", custom_error_message=text)


def unless_none(read: Callable[[Any], Any]) -> BeforeValidator:
    """Declare the reader of a key that need not be given."""
    return BeforeValidator(lambda value: None if value is None else read(value))


def is_number(value: Any) -> bool:
    """Return whether ``value`` is a finite int or float; a bool is not a number."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def are_numbers(value: Any, count: int | None = None) -> bool:
    """Return whether ``value`` is a list of finite numbers, at least one or ``count`` of them."""
    return isinstance(value, list | tuple) and len(value) == (count or len(value) or 1) and all(map(is_number, value))


def numbers_or(text: str, count: int | None = None, sound: Callable[[Any], bool] = bool) -> Callable[[Any], Any]:
    """Return a reader of a list of finite numbers, ``count`` or at least one, that refuses all else with a text."""

    def read(value: Any) -> tuple[float, ...]:
        if not are_numbers(value, count) or not sound(value):
            raise refuse(text)
        return tuple(map(float, value))

    return read


class UnitVector(tuple[float, float, float]):
    """A direction of length 1; ``written`` is the vector in the file, of any length, whose components have keys."""

    written: tuple[float, float, float]


def _three_numbers(value: Any) -> tuple[float, float, float]:
    value = written(value)
    if not are_numbers(value, 3):
        raise refuse("not a vector; allowed: three finite numbers [x, y, z]; write all three")
    return (float(value[0]), float(value[1]), float(value[2]))


def _unit(value: tuple[float, float, float]) -> UnitVector:
    length = math.hypot(*value)
    if not 0 < length < math.inf:
        raise refuse("has no direction; allowed: any vector but [0, 0, 0]; write the direction")
    # a division by almost 1 would change only the last bits
    direction = UnitVector(value if abs(length - 1) < 1e-14 else [x / length for x in value])
    direction.written = value
    return direction


def _divisible(value: float) -> float:
    if value < SMALLEST_NUMBER:
        raise refuse(f"too small for a physical quantity; allowed: from {SMALLEST_NUMBER:g}; correct it")
    return value


Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
PositiveNumber = Annotated[Number, Field(gt=0), AfterValidator(_divisible)]
Vector = Annotated[tuple[float, float, float], BeforeValidator(_three_numbers), Axes()]
Direction = Annotated[Vector, AfterValidator(_unit), PlainSerializer(written, return_type=tuple[float, float, float])]
Point = Annotated[Vector, Quantity("length")]
Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$")]

NonNegative = Annotated[Number, Field(ge=0)]
Radian = Annotated[Number, Quantity("angle")]
Length = Annotated[Number, Quantity("length")]
PositiveLength = Annotated[PositiveNumber, Quantity("length")]
OptionalLength = Annotated[PositiveLength | None, Quantity("length")]
Friction = Annotated[NonNegative, Quantity("number")]
Restitution = Annotated[Number, Field(ge=0, le=1), Quantity("number")]


class BodyPoint(TableModel):
    """A point that moves with a body."""

    body: Name = Field(description="the body the point belongs to")
    point: Point = Field(description="the point, in the frame of the body")

    @property
    def place(self) -> tuple[float, float, float]:
        """Where the part has the point, in the frame of the body."""
        return self.point


class PairLaw(TableModel):
    """The contact law between two bodies: that of a pair of materials, or its own numbers."""

    material: Name | None = optional("the pair of materials, a table of [materials]; default: that between the bodies'")
    friction: Annotated[Friction | None, Quantity("number")] = optional(
        "the coefficient of friction, instead of the material's"
    )
    static_friction: Annotated[Friction | None, Quantity("number")] = added(
        "the coefficient of friction until it slides, at least friction; default: the material's, unless friction is "
        "given; else friction"
    )
    restitution: Annotated[Restitution | None, Quantity("number")] = optional(
        "the coefficient of restitution, instead of the material's"
    )

    @model_validator(mode="after")
    def _static_holds_more(self) -> Self:
        check_static(self.static_friction, self.friction or 0.0)
        return self

    @property
    def spring(self) -> tuple[float, float]:
        """Stiffness and damping where it overlaps; 0: rigid."""
        return 0.0, 0.0


def check_spring(table: Any) -> None:
    """Refuse the table of a contact or stop with a damping and no stiffness, or a stiffness and a restitution."""
    hertz = getattr(table, "hertz_stiffness", None)
    if hertz is not None and table.stiffness is not None:
        text = "the force follows the overlap in one way; allowed: one of stiffness, hertz_stiffness; remove one"
        raise refuse(text, key="hertz_stiffness", value=hertz)
    if table.damping is not None and table.stiffness is None and hertz is None:
        text = "a rigid contact has no damping of its own; allowed: with a stiffness; give one, or write a restitution"
        raise refuse(text, key="damping", value=table.damping)
    if (table.stiffness is not None or hertz is not None) and table.restitution:
        text = "a contact with a stiffness bounces by itself; allowed: one of the two; remove it, and let damping take "
        raise refuse(f"{text}the energy, or remove the stiffness", key="restitution", value=table.restitution)


def check_static(static: float | None, sliding: float) -> None:
    """Refuse a coefficient of friction of a contact that sticks below that of one that slides."""
    if static is not None and static < sliding:
        text = f"what sticks would hold less than the friction with which it slides, {sliding:g}; allowed: >= "
        raise refuse(f"{text}friction; raise it, or lower friction", key="static_friction", value=static)


def check_one_at_rest(table: Any) -> None:
    """Refuse a coefficient of friction at rest beside a table over the speed, which begins with one."""
    if table.friction_over_speed is not None and table.static_friction is not None:
        text = "friction_over_speed begins with what holds at rest; allowed: one of the two; remove this one"
        raise refuse(text, key="static_friction", value=table.static_friction)


def check_perpendicular(first: Sequence[float], second: Sequence[float], names: tuple[str, str]) -> None:
    """Refuse the table if direction ``names[1]`` is not perpendicular to ``names[0]``; both have unit length."""
    lean = sum(a * b for a, b in zip(first, second, strict=True))
    if abs(lean) > PERPENDICULAR:
        text = f"not across {names[0]} ({names[0]} . {names[1]} = {lean:.2g}); allowed: perpendicular to {names[0]}; "
        raise refuse(f"{text}correct one of the two", key=names[1], value=list(second))
