"""Expressions are arithmetic and nothing else: their values, and what is refused."""

import contextlib
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine.mechanism.expression import DEEPEST, ExpressionFault, evaluate, names_in, parse
from tests.each import each

VALUES = {"a": 3.0, "b": 4.0, "arm": 12.0, "pi2": 1.0}


def value(text):
    """Return the value of an expression."""
    return evaluate(parse(text), VALUES)


@each(
    ("text", "expected"),
    [
        ("arm", 12.0),
        ("-arm/2", -6.0),
        ("a + b*2", 11.0),
        ("a - b - 1", -2.0),
        ("arm/a/2", 2.0),
        ("-a**2", -9.0),
        ("2**-1", 0.5),
        ("2**3**2", 512.0),
        ("(a + b) * -2", -14.0),
        ("1.5e-3*2", 3e-3),
        (".5", 0.5),
        ("hypot(a, b) + max(a, b) + min(a, b)", 12.0),
        ("sqrt(abs(-a*a))", 3.0),
        ("sin(pi/2) + cos(0) + atan2(0, 1)", 2.0),
        ("radians(180) - pi", 0.0),
        ("pi2", 1.0),
    ],
)
def test_values(text, expected):
    """As in mathematics: powers from the right and before signs, the rest from the left."""
    assert value(text) == expected


@given(st.floats(0.01, 100), st.floats(0.01, 100), st.floats(-100, 100))
def test_values_are_those_of_python(a, b, c):
    """Operation for operation, to the last bit."""
    found = evaluate(parse("a*b - c/a + (a - b)*c - -b"), {"a": a, "b": b, "c": c})
    assert found == a * b - c / a + (a - b) * c - -b
    assert evaluate(parse("a*cos(c) + sqrt(b)"), {"a": a, "b": b, "c": c}) == a * math.cos(c) + math.sqrt(b)


@each(
    ("text", "said"),
    [
        ("1e308**9", "is not a finite number"),
        ("1e308*10", "is not a finite number"),
        ("9**9**9**9", "is not a finite number"),
        ("1e999", "is not a finite number"),
        ("1/0", "1 / 0 is not a finite number"),
        ("0**-1", "is not a finite number"),
        ("(-8)**0.5", "is not a finite number"),
        ("sqrt(-1)", "sqrt(-1) is not a finite number"),
        ("(" * 60 + "1" + ")" * 60, f"nested deeper than {DEEPEST}"),
        ("-" * 150 + "1", f"nested deeper than {DEEPEST}"),
        ("1" + "+1" * 200, "up to 200"),
        ("", "a number, a parameter or a function"),
        ("12 mm", "'mm' after 12"),
        ("2a", "* for a product"),
        ("12,5", "write a decimal point"),
        ("a^2", "write ** for a power"),
        ("a(3)", "a(...) is not a function"),
        ("arm.__class__", "'.' has no meaning"),
        ("__import__('os')", "has no meaning"),
        ("a if b else 1", "'if' comes where"),
        ("a = 3", "'=' has no meaning"),
        ("\uff11", "has no meaning"),
        ("a b", "'b' comes where"),
        ("sqrt()", "')' comes where"),
        ("atan2(1)", "')' comes where ,"),
        ("(a", "the end comes where )"),
        ("arn", "did you mean 'arm'?"),
        ("width", "nor is width a parameter; [parameters] has a, b, arm, pi2"),
    ],
)
def test_what_is_refused(text, said):
    """Texts that are no expression, and values that are no number: the message says which part, and the remedy."""
    with pytest.raises(ExpressionFault) as caught:
        value(text)
    assert said in str(caught.value)


@given(st.text(st.sampled_from("ab12.e+-*/(),^ \t_'[]{}%"), max_size=40))
def test_no_text_raises_anything_else(text):
    """A value that is finite, or one kind of error."""
    with contextlib.suppress(ExpressionFault):
        assert math.isfinite(value(text))


def test_names():
    """Parameters alone: neither functions nor pi."""
    assert list(names_in(parse("a*sqrt(b) + pi - a"))) == ["a", "b", "a"]
