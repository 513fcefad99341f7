"""Arrays of numbers that form one value of a file, such as a mesh of points or a knot vector, without keys inside."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import core_schema

from engine.arrays import Array
from engine.mechanism.base import LARGEST_NUMBER, is_number, refuse


class FixedArray:
    """An immutable array; two are equal if all their numbers are."""

    __slots__ = ("numbers",)

    def __init__(self, numbers: Array) -> None:
        numbers = np.array(numbers, float)
        numbers.setflags(write=False)
        self.numbers = numbers

    def __eq__(self, other: object) -> bool:
        return isinstance(other, FixedArray) and np.array_equal(self.numbers, other.numbers)

    def __hash__(self) -> int:
        return hash(self.numbers.tobytes())

    def __repr__(self) -> str:
        return f"FixedArray{self.numbers.shape}"


class ArrayOf:
    """The requirements for an array in a file, as the annotation of a field with the type `FixedArray`.

    A length 0 in ``shape`` stands for any length from 1 to ``most``; ``words`` describes the array and its notation,
    for messages.
    """

    def __init__(self, shape: tuple[int, ...], words: str, most: int) -> None:
        self.shape, self.words, self.most = shape, words, most

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        """Read the array from lists, and write it as lists."""
        to_lists: Callable[[Any], Any] = lambda value: value.numbers.tolist()  # noqa: E731
        return core_schema.no_info_plain_validator_function(
            self.read, serialization=core_schema.plain_serializer_function_ser_schema(to_lists)
        )

    def __get_pydantic_json_schema__(self, schema: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Describe the nested lists."""
        described: dict[str, Any] = {"type": ["number"]}  # a list of types, so that no expression is allowed here
        for length in reversed(self.shape):
            bounds = {"minItems": length or 1, "maxItems": length or self.most}
            described = {"type": "array", "items": described, **bounds}
        return described

    def read(self, value: Any) -> FixedArray:
        """Return the array of nested lists of numbers.

        Raise the error of `refuse` if the lists have other lengths, or contain anything but finite numbers.
        """
        if isinstance(value, FixedArray):
            value = value.numbers.tolist()
        fault = self._fault(value, self.shape)
        if fault:
            raise refuse(f"{fault}; allowed: {self.words}")
        numbers = np.array(value, float)
        if not np.all(np.abs(numbers) <= LARGEST_NUMBER):
            raise refuse(f"has a number beyond any real quantity; allowed: sizes up to {LARGEST_NUMBER:g}")
        return FixedArray(numbers)

    def _fault(self, value: Any, shape: tuple[int, ...], at: str = "") -> str:
        """Return the first fault of nested lists; empty if there is none."""
        if not shape:
            return "" if is_number(value) and math.isfinite(value) else f"{at or 'it'} is not a finite number"
        if not isinstance(value, list | tuple):
            return f"{at or 'it'} is not a list"
        if shape[0] and len(value) != shape[0]:
            return f"{at or 'it'} has {len(value)} entries and not {shape[0]}"
        if not 1 <= len(value) <= (shape[0] or self.most):
            return f"{at or 'it'} has {len(value)} entries and not 1 to {self.most}"
        lengths = {len(item) for item in value if isinstance(item, list | tuple)}
        if len(shape) > 1 and len(lengths) > 1:
            return f"{at or 'it'} has rows of different lengths"
        return next((text for i, item in enumerate(value) if (text := self._fault(item, shape[1:], f"{at}[{i}]"))), "")
