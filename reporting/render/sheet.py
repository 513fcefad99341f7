"""One sheet of a workbook: the head stays in view, columns fit their texts, numbers have few enough digits to read."""

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

from reporting.format_numbers import decimals_for, fixed, plain

if TYPE_CHECKING:
    from xlsxwriter import Workbook
    from xlsxwriter.format import Format

DIGITS = 6  # shown in a cell, which stores the full number
LEAST_WIDTH, MOST_WIDTH = 9, 60  # width of a column in letters; longer texts are wrapped
LONGEST_TEXT = 32_000  # letters; Excel allows 32,767
_SMALLEST = 1e-6  # smaller numbers are shown with an exponent


class SheetWriter:
    """Writes the sheets of one workbook.

    No displayed number is rounded onto or across one of `fences`: limits, and the thresholds of an index. `colours` are
    background colours of a cell, by its word.
    """

    def __init__(self, book: "Workbook", fences: Iterable[float], colours: Mapping[str, str]) -> None:
        self._book, self._fences = book, tuple(fences)
        self._head = book.add_format(
            {"bold": True, "text_wrap": True, "valign": "top", "bottom": 1, "bg_color": "#F4F6F9"}
        )
        self._text = book.add_format({"text_wrap": True, "valign": "top"})
        self._words = {word: book.add_format({"bg_color": c, "valign": "top"}) for word, c in colours.items()}
        # One format for each pattern, because the workbook keeps every format that is added.
        self._numbers = cache(self._number_format)

    def write(self, name: str, heads: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
        """Write a sheet of texts, numbers and None, which becomes an empty cell; all headings differ."""
        sheet = self._book.add_worksheet(name)
        sheet.freeze_panes(1, 1)
        sheet.set_landscape()
        sheet.repeat_rows(0)
        sheet.fit_to_pages(1, 0)
        widths = [max(map(len, head.split())) for head in heads]
        for column, head in enumerate(heads):
            sheet.write_string(0, column, head, self._head)
        last = 0
        for last, row in enumerate(rows, start=1):
            for column, value in enumerate(row):
                if isinstance(value, str):
                    sheet.write_string(last, column, value[:LONGEST_TEXT], self._words.get(value, self._text))
                    widths[column] = max(widths[column], len(value))
                elif value is not None and math.isfinite(value):
                    pattern = number_pattern(value, self._fences)
                    sheet.write_number(last, column, value, self._numbers(pattern))
                    widths[column] = max(widths[column], len(pattern) + len(str(abs(int(value)))))
        for column, width in enumerate(widths):
            sheet.set_column(column, column, min(max(width + 2, LEAST_WIDTH), MOST_WIDTH))
        sheet.autofilter(0, 0, last, len(heads) - 1)

    def _number_format(self, pattern: str) -> "Format":
        """Return the format of numbers with a pattern."""
        return self._book.add_format({"num_format": pattern, "valign": "top"})


def number_pattern(value: float, fences: Sequence[float]) -> str:
    """Return Excel's format of a number: as given if it is short, else with `DIGITS` digits, or more near a fence."""
    short = plain(value)
    if "e" not in short and len(short.lstrip("-0.").replace(".", "")) <= DIGITS:
        return "General"
    if abs(value) < _SMALLEST:
        return f"0.{'0' * (DIGITS - 1)}E+00"
    decimals = len(fixed(value, decimals_for(value, DIGITS), fences).partition(".")[2])
    return f"0.{'0' * decimals}" if decimals else "0"
