"""The examples of docs/report.md print what they say."""

import doctest
from pathlib import Path


def test_examples_of_the_report_page() -> None:
    page = Path(__file__).parents[2] / "docs" / "report.md"
    result = doctest.testfile(str(page), module_relative=False)
    assert result.attempted >= 4
    assert result.failed == 0
