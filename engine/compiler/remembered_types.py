"""Remember Numba's choices of built-in functions while a kernel compiles.

For each call of a built-in function or operator Numba tries all declared implementations with all possible argument
types, first in type inference and again in code generation. This took a fifth of the compilation time: the kernels
contain 20,000 such calls, and hardly a thousand different ones.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from numba.core.targetconfig import ConfigStack
from numba.core.types.functions import BaseFunction

_choose = BaseFunction.get_call_type


class ChosenFunctions:
    """Numba's choices so far: signatures by function, argument types and compiler options."""

    def __init__(self) -> None:
        self._signatures: dict[Any, Any] = {}
        self._options: list[Any] = []  # all different
        self._numbers: dict[int, tuple[int, Any]] = {}  # by the id of the options, which are kept alive for this

    def choose(self, function: Any, context: Any, arguments: Any, named: Any) -> Any:
        """Return the signature with which a function is called, as ``get_call_type`` of Numba's functions does."""
        options = ConfigStack.top_or_none()  # type: ignore[no-untyped-call]
        key = id(function), id(context), self._number(options), arguments, tuple(named.items())
        if key not in self._signatures:
            self._signatures[key] = _choose(function, context, arguments, named), function
        return self._signatures[key][0]

    def _number(self, options: Any) -> int:
        """Return a number that is the same for equal compiler options."""
        if id(options) not in self._numbers:
            if options not in self._options:
                self._options.append(options)
            self._numbers[id(options)] = self._options.index(options), options
        return self._numbers[id(options)][0]


@contextmanager
def choices_remembered() -> Iterator[None]:
    """Remember choices inside the block, which holds Numba's lock; nested blocks have no effect."""
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
