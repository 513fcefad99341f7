"""One test for many items."""

import inspect

import pytest

from tests.each import each


def test_all_that_fail_are_named():
    """Whatever they raise; and the first failure is the cause, with the place where it happened."""

    @each("number", [1, 0, 3])
    @each("word, power", [("first", 1), ("second", 2)])
    def check(number, word, power, most):
        if number == 3:
            pytest.fail("three")
        assert 8 / number <= most, word

    with pytest.raises(AssertionError) as failed:
        check(most=8)
    assert [line.split(": ")[:3] for line in str(failed.value).splitlines()] == [
        ["2 of 3 fail:"],
        ["  1", "0", "AssertionError"],
        ["    0", "'first', 1", "ZeroDivisionError"],
        ["    1", "'second', 2", "ZeroDivisionError"],
        ["  2", "3", "AssertionError"],
        ["    0", "'first', 1", "Failed"],
        ["    1", "'second', 2", "Failed"],
    ]
    assert isinstance(failed.value.__cause__.__cause__, ZeroDivisionError)


def test_items_are_no_fixtures():
    """Pytest provides the rest."""

    @each("first, second", [(1, 2)])
    def check(first, tmp_path, second, capsys):
        assert (first, second) == (1, 2)

    assert list(inspect.signature(check).parameters) == ["tmp_path", "capsys"]
    check(tmp_path=None, capsys=None)


def test_no_items_are_no_proof():
    """A list that came out empty is an error at once."""
    with pytest.raises(AssertionError, match="word"):
        each("word", [])
