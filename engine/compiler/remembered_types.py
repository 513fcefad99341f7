"""Numba's choices of built-in functions, remembered while a kernel compiles.

For every call of a built-in function or operator Numba tries all implementations that have been declared, with each of
the types that the arguments may have, first when it infers types and again when it writes code. That was a fifth of the
time of compiling: the kernels have 20,000 such calls, and hardly a thousand different ones.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from numba.core.targetconfig import ConfigStack
from numba.core.types.functions import BaseFunction

_choose = BaseFunction.get_call_type


class ChosenFunctions:
    """What Numba chose so far: signatures by function, types of the arguments and options of the compiler."""

    def __init__(self) -> None:
        self._signatures: dict[Any, Any] = {}
        self._options: list[Any] = []  # no two are equal
        self._numbers: dict[int, tuple[int, Any]] = {}  # by the identity of options, which are kept for that

    def choose(self, function: Any, context: Any, arguments: Any, named: Any) -> Any:
        """Return the signature with which a function is called, as ``get_call_type`` of Numba's functions does."""
        options = ConfigStack.top_or_none()  # type: ignore[no-untyped-call]
        key = id(function), id(context), self._number(options), arguments, tuple(named.items())
        if key not in self._signatures:
            self._signatures[key] = _choose(function, context, arguments, named), function
        return self._signatures[key][0]

    def _number(self, options: Any) -> int:
        """Return a number that equal options of the compiler have in common."""
        if id(options) not in self._numbers:
            if options not in self._options:
                self._options.append(options)
            self._numbers[id(options)] = self._options.index(options), options
        return self._numbers[id(options)][0]


@contextmanager
def choices_remembered() -> Iterator[None]:
    """Remember choices while the block runs, which holds Numba's lock; one within another has no effect."""
    if BaseFunction.get_call_type is not _choose:
        yield
        return
    chosen = ChosenFunctions()

    def get_call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
        return chosen.choose(self, context, args, kws)

    BaseFunction.get_call_type = get_call_type  # type: ignore[method-assign]
    try:
        yield
    finally:
        BaseFunction.get_call_type = _choose  # type: ignore[method-assign]
