"""Numba's choices of built-in functions are remembered while a kernel compiles, and no longer."""

import numpy as np
import pytest
from numba.core.errors import TypingError
from numba.core.types.functions import BaseFunction

from engine.jit import inner, kernel, numba_internals

CHOOSE = BaseFunction.get_call_type


@inner
def hypotenuse(a, b):
    """Return a length."""
    return np.sqrt(a * a + b * b)


def test_each_choice_is_made_once(monkeypatch):
    """The same operator with the same types is looked up once for a kernel, and once for all kernels below it."""
    made = []

    def choose(function, context, arguments, named):
        made.append((function.typing_key, arguments))
        return CHOOSE(function, context, arguments, named)

    monkeypatch.setattr(numba_internals, "_choose", choose)
    monkeypatch.setattr(BaseFunction, "get_call_type", choose)

    def lengths(x, n):
        return hypotenuse(x, x) + hypotenuse(x * x, x) + x * n + n * n

    products = kernel(lengths)
    assert products(2.0, 3) == pytest.approx(8**0.5 + 20**0.5 + 6.0 + 9.0)
    assert made
    assert max(map(made.count, made)) <= 2  # the kernel that Python calls has options of its own
    names = {(key.__name__, *map(str, arguments)) for key, arguments in made}
    assert {("mul", "float64", "float64"), ("mul", "float64", "int64"), ("mul", "int64", "int64")} <= names
    assert BaseFunction.get_call_type is choose


def test_numba_is_as_it_was_after_a_failure():
    """A kernel that does not compile leaves nothing behind."""

    @kernel
    def wrong(x):
        return x.nothing + 1

    with pytest.raises(TypingError, match="nothing"):
        wrong(1.0)
    assert BaseFunction.get_call_type is CHOOSE
