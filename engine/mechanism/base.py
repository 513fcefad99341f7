"""Building blocks of the tables in the file formats: the base class of their models, numbers, vectors and names."""

import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Annotated, Any, ClassVar, Self

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
from pydantic_core import InitErrorDetails, PydanticCustomError

from engine.mechanism.components import Axes, holds_numbers, written
from engine.mechanism.expression import ExpressionFault, evaluate, parse
from engine.mechanism.quantities import Quantity

LARGEST_NUMBER = 1e100  # in a file, so that squares and products of such numbers are finite
SMALLEST_NUMBER = 1e-100  # of numbers used as divisors
PERPENDICULAR = 1e-5  # largest cosine of the angle between two directions that should be perpendicular


class TableModel(BaseModel):
    """Base class of every table in a file that a user writes: immutable, and an unknown key is an error.

    Where a file offers a choice of tables, the value of the key ``kind_key`` selects one. The magnitude of each number
    is at most `LARGEST_NUMBER`, and at least ``smallest`` unless it is 0.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

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
                    raise refuse(_no_real_size(smallest), key=_keys(type(self))[name], value=number)
        return self

    def entries(self) -> dict[str, Any]:
        """Return the table by the keys used in the file (``from``, not ``from_``); its sub-tables remain models."""
        return {key: getattr(self, name) for name, key in _keys(type(self)).items()}


def refuse(text: str, *, key: str = "", value: Any = None) -> PydanticCustomError:
    """Return the error that a validator raises to refuse a value.

    The text says what is wrong; what is allowed; what to do. ``key`` is the key at fault inside the table, dotted;
    empty if the validated value itself is at fault.
    """
    return PydanticCustomError("refused", "{text}", {"text": text, "key": key, "value": value})


@cache
def _keys(model: type[BaseModel]) -> dict[str, str]:
    """Return the key in the file for the name of each field of a table."""
    return {name: field.alias or name for name, field in model.model_fields.items()}


@cache
def _number_keys(model: type[BaseModel]) -> frozenset[str]:
    """Return the keys of a table that hold a number or lists of numbers."""
    fields = model.model_fields.items()
    return frozenset(field.alias or name for name, field in fields if holds_numbers(field.annotation))


def with_numbers(value: Any, parameters: Mapping[str, float], key: str = "") -> Any:
    """Return a value from a file with each expression, also in nested lists, replaced by its number.

    Anything else is returned unchanged, as is a number in quotes; ``key`` is the position within the enclosing lists.
    Raise the error of `refuse` if an expression has no finite value.
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


def _no_real_size(smallest: float) -> str:
    """Return the message about a number too large or too small to describe anything real."""
    sizes = f"0, and sizes from {smallest:g} to" if smallest else "sizes up to"
    return f"no size of a real quantity; allowed: {sizes} {LARGEST_NUMBER:g}; correct it"


def one_of(**keys: str) -> Discriminator:
    """Return the discriminator for a choice of tables, each of which has a key that the others lack.

    Each table in the choice has this key as its tag and as its class variable ``distinguishing_key``; ``keys`` gives
    the meaning of each, for the error if none or several of them are given.
    """

    def tag_of(value: Any) -> str | None:
        entries = value.entries() if isinstance(value, TableModel) else value if isinstance(value, Mapping) else {}
        given = [key for key in keys if key in entries]
        return given[0] if len(given) == 1 else None

    meanings = ", ".join(f"{key} ({meaning})" for key, meaning in keys.items())
    text = f"which kind is meant? allowed: exactly one of {meanings}; keep or add one"
    return Discriminator(tag_of, custom_error_type="refused", custom_error_message=text)


def is_number(value: Any) -> bool:
    """Return whether ``value`` is a finite int or float; a bool is not a number."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


class UnitVector(tuple[float, float, float]):
    """A direction of length 1; ``written`` is the vector in the file, of any length, whose components have keys."""

    written: tuple[float, float, float]


def _three_numbers(value: Any) -> tuple[float, float, float]:
    value = written(value)
    if not isinstance(value, list | tuple) or len(value) != 3 or not all(map(is_number, value)):
        raise refuse("not a vector; allowed: three finite numbers [x, y, z]; write all three")
    return (float(value[0]), float(value[1]), float(value[2]))


def _unit(value: tuple[float, float, float]) -> UnitVector:
    length = math.hypot(*value)
    if not 0 < length < math.inf:
        raise refuse("has no direction; allowed: any vector but [0, 0, 0]; write the direction")
    if abs(length - 1) >= 1e-14:  # a division would otherwise change only the last bits
        direction = UnitVector((value[0] / length, value[1] / length, value[2] / length))
    else:
        direction = UnitVector(value)
    direction.written = value
    return direction


def _divisible(value: float) -> float:
    if value < SMALLEST_NUMBER:
        raise refuse(f"no size of a real quantity; allowed: from {SMALLEST_NUMBER:g}; correct it")
    return value


Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
PositiveNumber = Annotated[Number, Field(gt=0), AfterValidator(_divisible)]
Vector = Annotated[tuple[float, float, float], BeforeValidator(_three_numbers), Axes()]
Direction = Annotated[Vector, AfterValidator(_unit), PlainSerializer(written, return_type=tuple[float, float, float])]
Point = Annotated[Vector, Quantity("length")]
Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$")]

Length = Annotated[Number, Quantity("length")]
PositiveLength = Annotated[PositiveNumber, Quantity("length")]
Friction = Annotated[Number, Field(ge=0), Quantity("number")]
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

    material: Name | None = Field(
        default=None, description="the pair of materials, a table of [materials]; default: that between the bodies'"
    )
    friction: Annotated[Friction | None, Quantity("number")] = Field(
        default=None, description="the coefficient of friction, instead of the material's"
    )
    restitution: Annotated[Restitution | None, Quantity("number")] = Field(
        default=None, description="the coefficient of restitution, instead of the material's"
    )

    @property
    def spring(self) -> tuple[float, float]:
        """Stiffness and damping where it overlaps; 0: rigid."""
        return 0.0, 0.0


def not_given(value: Any) -> bool:
    """Return whether there is none; what is not given is left out of digests, so that those of earlier files stay."""
    return value is None


def check_spring(table: Any) -> None:
    """Refuse the table of a contact or stop with a damping and no stiffness, or a stiffness and a restitution."""
    if table.damping is not None and table.stiffness is None:
        raise refuse(
            "a rigid contact has no damping of its own; allowed: with a stiffness; give one, or write a restitution",
            key="damping",
            value=table.damping,
        )
    if table.stiffness is not None and table.restitution:
        raise refuse(
            "a contact with a stiffness bounces by itself; allowed: one of the two; remove it, and let damping take "
            "the energy, or remove the stiffness",
            key="restitution",
            value=table.restitution,
        )


def check_perpendicular(first: Sequence[float], second: Sequence[float], names: tuple[str, str]) -> None:
    """Refuse the table if direction ``names[1]`` is not perpendicular to ``names[0]``; both have unit length."""
    lean = sum(a * b for a, b in zip(first, second, strict=True))
    if abs(lean) > PERPENDICULAR:
        raise refuse(
            f"not across {names[0]} ({names[0]} . {names[1]} = {lean:.2g}); allowed: perpendicular to {names[0]}; "
            "correct one of the two",
            key=names[1],
            value=list(second),
        )
