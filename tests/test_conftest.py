"""What holds for all tests."""

from tests.conftest import LONGEST, TESTS


def test_the_longest_files_are_where_they_are_said_to_be():
    """A file that was moved would no longer start first."""
    assert [path for path in LONGEST if not (TESTS / path).exists()] == []
