"""One test for many items that share what they need: it names all that fail, not only the first."""

import functools
import inspect
import textwrap
from collections.abc import Callable, Iterable
from typing import Any

import pytest

LONGEST = 200  # characters of an item in a message


def each(
    names: str | tuple[str, ...], items: Iterable[Any], made: Callable[[Any], Any] | None = None
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Call a test with each of some items in turn: a value, or a tuple of one for each of several names.

    What the test needs besides is there once for all items: it suits tests that change nothing of it. What a test
    changes is ``made`` anew of each item, which then has one name.
    """
    keys = [name.strip() for name in names.split(",")] if isinstance(names, str) else list(names)
    chosen = [tuple(item) if len(keys) > 1 else (item,) for item in items]
    assert chosen, f"no {names}: the test would prove nothing"

    def decorated(test: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(test)
        def with_each(**needed: Any) -> None:
            failures, first = [], None
            for number, values in enumerate(chosen):
                try:
                    given = values if made is None else (made(*values),)
                    test(**needed, **dict(zip(keys, given, strict=True)))
                except (Exception, pytest.fail.Exception) as failure:
                    first = first or failure
                    failures.append(f"{number}: {_named(values)}: {type(failure).__name__}: {failure}")
            if failures:
                text = textwrap.indent("\n".join(failures), "  ")
                raise AssertionError(f"{len(failures)} of {len(chosen)} fail:\n{text}") from first

        signature = inspect.signature(test)
        others = [parameter for name, parameter in signature.parameters.items() if name not in keys]
        with_each.__signature__ = signature.replace(parameters=others)  # what pytest provides
        return with_each

    return decorated


def _named(values: tuple[Any, ...]) -> str:
    """Return the values of an item in words, not at any length."""
    words = ", ".join(getattr(value, "__name__", None) or repr(value) for value in values)
    return words if len(words) <= LONGEST else f"{words[:LONGEST]}..."
