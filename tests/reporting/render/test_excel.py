"""Sheets of the workbook: digits to read that never cross a limit, columns wide enough, heads that differ."""

from pathlib import Path

import openpyxl

from reporting import write_report
from reporting.render.excel import LEAST_WIDTH, MOST_WIDTH, number_pattern
from tests.each import each

FENCES = (1.0, 1.33, 16.0)


@each(
    ("value", "pattern"),
    [
        (0, "General"),
        (2018, "General"),
        (0.535, "General"),
        (-12.6, "General"),
        (1.269249691943442, "0.00000"),
        (12.62939571, "0.0000"),
        (-0.0766707740874, "0.0000000"),
        (7461.355528799601, "0.00"),
        (1234567.891, "0"),
        (1.3299999, "0.0000000"),
        (15.9999996, "0.0000000"),
        (3.41e-9, "0.00000E+00"),
    ],
)
def test_a_number_shows_six_digits_and_crosses_no_limit(value, pattern) -> None:
    """Its cell holds all of them."""
    assert number_pattern(value, FENCES) == pattern


def test_nothing_is_cut_off(campaign, tmp_path: Path) -> None:
    """Texts fit into their columns or are wrapped; heads are no two the same; there is no formula; pages fit paper."""
    book = openpyxl.load_workbook(write_report(*campaign(60, 4), tmp_path, kinds=("xlsx",))["xlsx"])
    for sheet in book.worksheets:
        heads = [cell.value for cell in sheet[1]]
        assert len(set(heads)) == len(heads), sheet.title
        assert (sheet.freeze_panes, sheet.print_title_rows) == ("B2", "$1:$1")
        assert (sheet.page_setup.orientation, sheet.page_setup.fitToHeight) == ("landscape", 0)
        for column in sheet.iter_cols():
            width = sheet.column_dimensions[column[0].column_letter].width
            assert LEAST_WIDTH <= width <= MOST_WIDTH + 1, sheet.title
            for cell in column:
                assert cell.data_type in ("s", "n"), f"{sheet.title}!{cell.coordinate}"
                if isinstance(cell.value, str):
                    assert len(cell.value) < width or cell.alignment.wrap_text, f"{sheet.title}!{cell.coordinate}"


def test_long_findings_are_wrapped_and_words_have_their_colour(campaign, tmp_path: Path) -> None:
    book = openpyxl.load_workbook(write_report(*campaign(60), tmp_path, kinds=("xlsx",))["xlsx"])
    findings = [cell for cell in book["Trust"]["C"] if len(cell.value) > MOST_WIDTH]
    assert findings
    assert all(cell.alignment.wrap_text and cell.alignment.vertical == "top" for cell in findings)
    verdicts = [cell for cell in book["Summary"]["C"] if cell.value in ("capable", "marginal", "not capable")]
    assert verdicts
    assert all(cell.fill.fgColor.rgb != "00000000" for cell in verdicts)
    means = [cell for cell in book["Summary"]["M"][1:] if cell.value is not None]
    assert all(cell.font.bold for cell in book["Summary"]["D"][1:] if cell.value is not None)
    assert all(cell.number_format != "General" for cell in means)
