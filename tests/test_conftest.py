"""What holds for all tests."""

import gc
import re

from tests.conftest import LONGEST, TESTS


def test_the_longest_files_are_where_they_are_said_to_be():
    """A file that was moved would no longer start first."""
    assert [path for path in LONGEST if not (TESTS / path).exists()] == []


def test_what_runs_alone_is_found():
    """`make prove` looks for it in one folder: to collect all tests for two of them takes a quarter of a minute."""
    recipe = (TESTS.parent / "Makefile").read_text()
    folder = re.search(r"pytest (\S+) -m alone$", recipe, re.M)[1]
    marked = [path for path in TESTS.rglob("*.py") if re.search(r"\bmark\.alone\b", path.read_text())]
    assert [path for path in marked if not path.is_relative_to(TESTS.parent / folder)] == []
    assert marked != []


def test_garbage_is_looked_for_again_after_collection():
    """What was there by then is not looked at any more."""
    assert gc.isenabled()
    assert gc.get_freeze_count() > 0
