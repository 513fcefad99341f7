"""The examples of the pages on reporting print what the pages show."""

import doctest
from pathlib import Path

import pytest


@pytest.mark.parametrize("name", ["report.md", "sensitivity.md"])
def test_examples_of_the_report_page(name: str) -> None:
    page = Path(__file__).parents[2] / "docs" / name
    result = doctest.testfile(str(page), module_relative=False)
    assert result.attempted >= 4
    assert result.failed == 0
