"""Expressions over parameters, such as ``"arm / 2"``: arithmetic only, read by a dedicated parser, never run as code.

An expression consists of numbers, names of parameters, ``+ - * / **``, parentheses, ``pi`` and a few functions. ``**``
binds tighter than a sign before it and is right-associative, as in mathematics; the other operators are
left-associative.
"""

import math
import re
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from operator import add, mul, sub, truediv
from typing import Any

from engine.mechanism.closest import closest

LONGEST = 200  # characters
DEEPEST = 30  # nested parentheses, functions, signs and powers

FUNCTIONS: dict[str, tuple[int, Callable[..., float]]] = {
    "sqrt": (1, math.sqrt),
    "sin": (1, math.sin),
    "cos": (1, math.cos),
    "tan": (1, math.tan),
    "asin": (1, math.asin),
    "acos": (1, math.acos),
    "atan": (1, math.atan),
    "atan2": (2, math.atan2),
    "hypot": (2, math.hypot),
    "abs": (1, abs),
    "min": (2, min),
    "max": (2, max),
    "radians": (1, math.radians),
}
"""Name -> number of arguments and the function. Angles are in rad."""

CONSTANTS = {"pi": math.pi}
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")

Node = float | str | tuple[Any, ...]
"""A number, the name of a parameter, or an operation: its sign or function, then its operands."""

_TOKEN = re.compile(
    r"(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<name>[A-Za-z][A-Za-z0-9_]*)|(?P<sign>\*\*|[-+*/(),])",
    re.ASCII,
)
_BINDS = {"+": 1, "-": 1, "*": 2, "/": 2, "**": 4}
_OPERATORS: dict[str, Callable[..., float]] = {"+": add, "-": sub, "*": mul, "/": truediv, "**": math.pow}
_SIGN_BINDS = 3  # -a**2 is -(a**2), and -a*b is (-a)*b
_END = ("end", "the end")


class ExpressionFault(ValueError):
    """A text is not an expression, or has no finite value; the message says what is wrong and what is allowed."""


@lru_cache(maxsize=4096)
def parse(text: str) -> Node:
    """Return the tree of an expression; raise ExpressionFault if a text is none, too long, or nested too deeply."""
    if len(text) > LONGEST:
        raise ExpressionFault(f"an expression of {len(text)} characters; allowed: up to {LONGEST}; use more parameters")
    reader = ExpressionReader(text)
    node = reader.operation(1)
    reader.expect(_END)
    return node


def names_in(node: Node) -> Iterator[str]:
    """Yield the parameters used in an expression, once per use."""
    if isinstance(node, str):
        yield node
    elif isinstance(node, tuple):
        for operand in node[1:]:
            yield from names_in(operand)


def names_in_text(text: str) -> list[str]:
    """Return the names in a text, once per use; none if it is not an expression."""
    try:
        return list(names_in(parse(text)))
    except ExpressionFault:
        return []


def evaluate(node: Node, values: Mapping[str, float]) -> float:
    """Return the value of an expression; raise ExpressionFault if a name is no parameter, or it has no real value."""
    if isinstance(node, float):
        return node
    if isinstance(node, str):
        if node not in values:
            defined = ", ".join(list(values)[:20]) or "none"
            meant = closest(node, values)
            question = f"; did you mean '{meant}'?" if meant else ""
            raise ExpressionFault(
                f"not a finite number, nor is {node} a parameter; [parameters] has {defined}; define it there{question}"
            )
        return values[node]
    operation, *operands = node
    numbers = [evaluate(operand, values) for operand in operands]
    try:
        result = float(_apply(operation, numbers))
    except (ValueError, OverflowError, ZeroDivisionError):
        result = math.nan
    if not math.isfinite(result):
        texts = [f"{number:g}" for number in numbers]
        shown = f"{operation}({', '.join(texts)})" if operation in FUNCTIONS else f" {operation} ".join(texts)
        raise ExpressionFault(f"{shown} is not a finite number; change the expression or a parameter")
    return result


def _apply(operation: str, numbers: list[float]) -> float:
    """Return the result of one operation; Python's errors are raised where it has none."""
    if operation in FUNCTIONS:
        return FUNCTIONS[operation][1](*numbers)
    if len(numbers) == 1:
        return -numbers[0] if operation == "-" else numbers[0]
    return _OPERATORS[operation](*numbers)


class ExpressionReader:
    """Reads an expression from left to right by operator precedence."""

    def __init__(self, text: str) -> None:
        self._tokens = list(_tokens(text))
        self._next = 0
        self._depth = 0

    def operation(self, least: int) -> Node:
        """Read operands and the operators between them that bind at least as tightly as ``least``."""
        self._depth += 1
        if self._depth > DEEPEST:
            raise ExpressionFault(f"nested deeper than {DEEPEST}; use more parameters")
        node = self._operand()
        while self._token[0] == "sign" and (binds := _BINDS.get(self._token[1], 0)) >= least:
            sign = self._take()[1]
            node = (sign, node, self.operation(binds if sign == "**" else binds + 1))
        self._depth -= 1
        return node

    def expect(self, token: tuple[str, str]) -> None:
        """Read one token and check that it is the given one."""
        if self._token != token:
            raise ExpressionFault(self._surprise(f"{token[1]} or an operation"))
        self._next += 1

    @property
    def _token(self) -> tuple[str, str]:
        return self._tokens[self._next] if self._next < len(self._tokens) else _END

    def _take(self) -> tuple[str, str]:
        self._next += 1
        return self._tokens[self._next - 1]

    def _operand(self) -> Node:
        """Read a number, a parameter, a function, an expression in parentheses, or one of these with a sign."""
        kind, text = self._token
        if kind == "number":
            if not math.isfinite(float(self._take()[1])):
                raise ExpressionFault(f"{text} is not a finite number; correct it")
            return float(text)
        if kind == "name":
            self._take()
            return self._function(text) if self._token == ("sign", "(") else CONSTANTS.get(text, text)
        if text in ("+", "-"):
            self._take()
            return (text, self.operation(_SIGN_BINDS))
        if text == "(":
            self._take()
            node = self.operation(1)
            self.expect(("sign", ")"))
            return node
        raise ExpressionFault(self._surprise("a number, a parameter or a function"))

    def _function(self, name: str) -> Node:
        """Read the arguments of a function."""
        if name not in FUNCTIONS:
            raise ExpressionFault(f"{name}(...) is not a function; allowed: {', '.join(FUNCTIONS)}; a product needs *")
        self._take()
        arguments = [self.operation(1)]
        for _ in range(FUNCTIONS[name][0] - 1):
            self.expect(("sign", ","))
            arguments.append(self.operation(1))
        self.expect(("sign", ")"))
        return (name, *arguments)

    def _surprise(self, wanted: str) -> str:
        """Return the message that a different token stands where something is expected."""
        before = self._tokens[self._next - 1] if self._next else ("", "")
        kind, text = self._token
        if before[0] == "number" and kind == "name":
            return f"{text!r} after {before[1]}: allowed: numbers without unit, and * for a product; correct it"
        if text == ",":
            return "a comma; allowed: only between the arguments of a function; write a decimal point"
        place = text if kind == "end" else repr(text)
        return f"{place} comes where {wanted} is expected; correct the expression"


def _tokens(text: str) -> Iterator[tuple[str, str]]:
    """Yield the kind and text of each token."""
    at = 0
    while at < len(text):
        if text[at] in " \t":
            at += 1
            continue
        match = _TOKEN.match(text, at)
        if match is None:
            remedy = "write ** for a power" if text[at] == "^" else "correct the expression"
            raise ExpressionFault(
                f"{text[at]!r} has no meaning; allowed: numbers, parameters, + - * / ** ( ) pi and "
                f"{', '.join(FUNCTIONS)}; {remedy}"
            )
        yield str(match.lastgroup), match[0]
        at = match.end()
