"""Tables of measurements as gauges and spreadsheets write them: no number is read a thousandfold or a column wrong."""

import numpy as np
import openpyxl
import pandas as pd
import pytest

from campaign.errors import SpecError
from clearcap.questions.measured import asked_of_parts, gauge_study
from tests.each import each


def values(parts, *names, **keys):
    """Return the columns that a limits file without limits asks for, in a list if there are several."""
    table, _ = asked_of_parts(parts, {"characteristics": {name: {} for name in names or ("F",)}, **keys})
    found = [table[name].to_pylist() for name in names or ("F",)]
    return found if len(found) > 1 else found[0]


def written(folder, text, encoding="utf-8"):
    (folder / "a.csv").write_bytes(text.encode(encoding))
    return folder / "a.csv"


@each(
    "text, expected",
    [
        ("F\n1.501,62\n998,20\n1.002,00\n", [1501.62, 998.2, 1002.0]),  # groups of digits, in many countries
        ('F\n"1,501.62"\n998.2\n', [1501.62, 998.2]),
        ('F;G\n"1,234,567";1\n', [1234567.0]),
        ("F\n1\u00a0501,62\n1\u202f002,5\n", [1501.62, 1002.5]),
        ("F\n1'501.62\n1\u2019002.5\n", [1501.62, 1002.5]),
        ("F\n1 501\n1 002,5\n", [1501.0, 1002.5]),
        ("F\n20,001\n19,998\n", [20.001, 19.998]),  # three decimals
        ("n;F\n1;20,001\n2;19,998\n", [20.001, 19.998]),
        ("F\n1.515\n1.498\n", [1.515, 1.498]),
        ("F\n20,001\n0,998\n7\n", [20.001, 0.998, 7.0]),
        ("F\n\u22120.74\n+1.5e3\n", [-0.74, 1500.0]),
        (" n ; F \n 1 ; 20,01 \n", [20.01]),
        ("sep=;\nn;F\n1;20,01\n", [20.01]),
        ("\n\nF;\n20,01;\n", [20.01]),  # a separator at the end of each line
        ("n;F\n1;20,01;\n2;20,02;\n", [20.01, 20.02]),
        ('"n\nof part";F\n1;20,01\n', [20.01]),
    ],
)
def test_numbers_of_many_countries(text, expected, tmp_path):
    assert values(written(tmp_path, text)) == expected


@each(
    "text, words",
    [
        # a thousandfold wrong, silently, if one of the readings were taken
        ('F\n"1,515"\n"1,498"\n', ["row 2", "1,515 may be 1515 or 1.515", "commas separate"]),
        ('n,F\n1,"1,515"\n', ["1,515 may be 1515 or 1.515"]),
        ("F\n998\n1.002\n", ["1.002 may be 1002 or 1.002", "no decimals"]),
        ("F\n998\n1,002\n", ["1,002 may be 1002 or 1.002"]),
        ("F\n1.002\n1,003\n", ["1.002 may be", "mixed"]),
        ("F\n1.2.3\n", ["row 2", "1.2.3 is no number"]),
        ("F\n12.34,5\n", ["12.34,5 is no number"]),
        ("F\n1_000\n", ["1_000 is no number"]),
        # decimal commas where commas separate the columns: cells would move to the next column
        ("n,F\n1,20,001\n2,19,998\n", ["line 2 has 3 cells", "2 names", "semicolons"]),
        ("Report 7\n\nn;F\n1;20,01\n", ["line 3 has 2 cells", "1 name", "above"]),
        ("n;F\n1;20,01\n2;20,02;good\n", ["line 3 has 3 cells"]),
        ("n;Sizes;\n;F;G\n1;20,01;3\n", ["no column F", "row 2 has a cell F", "above"]),
        ("F;F\n1;2\n", ["2 columns F", "rename"]),
        ("n;F\n\n1;20,01\n\n2;bad\n3;worse\n", ["row 5", "bad is no number, nor are those of 1 more row", "reject"]),
        ("F\n<0,01\n0,02\n", ["<0,01 is no number", "would count as a reject"]),
        ('F\n"20,01\n', ["quotation mark"]),
    ],
)
def test_what_may_be_read_in_two_ways_is_refused(text, words, tmp_path):
    with pytest.raises(SpecError) as refused:
        values(written(tmp_path, text))
    assert [word for word in words if word not in str(refused.value)] == []


def test_another_column_tells_what_a_point_means(tmp_path):
    """A column of 1.515 is 1,515 where its neighbour has decimal commas, or a gauge of another country's: refused."""
    for text in ("F;G\n1.515;20,25\n", 'F,G\n"1,515",20.25\n'):
        with pytest.raises(SpecError, match="column G has a decimal"):
            values(written(tmp_path, text), "F", "G")
    assert values(written(tmp_path, 'F,G\n"1,515","20,25"\n'), "F", "G") == [[1.515], [20.25]]


def test_parts_without_a_lot_are_no_lot():
    """Nor are rows without an operator an operator; spaces around a name mean nothing."""
    frame = pd.DataFrame({"F": [1.0, 2.0, 3.0], "lot": ["A", None, " "]})
    for key in ("lot", "subgroup"):
        with pytest.raises(SpecError, match=f"{key}: column lot, row 2 is empty, as 1 more cell is"):
            values(frame, **{key: "lot"})
    frame["lot"] = ["A", "B", "A "]
    assert asked_of_parts(frame, {"lot": "lot", "characteristics": {"F": {}}})[0]["production lot"].to_pylist() == [
        0,
        1,
        0,
    ]
    study = pd.DataFrame({"value": range(8), "part": [*"AABBAAB", ""], "operator": [*"xxxxyyyy"]})
    with pytest.raises(SpecError, match="part: column part, row 8 is empty"):
        gauge_study(study)


def test_encodings(tmp_path):
    for encoding in ("utf-8-sig", "utf-16", "cp1252"):
        assert values(written(tmp_path, "Größe;F\n1;20,01\n", encoding), "Größe", "F") == [[1.0], [20.01]]


def test_a_part_without_any_value_counts_where_a_table_has_it(tmp_path):
    """A row of pandas or Parquet is a part; an empty line of a file is none, as spreadsheets leave them."""
    frame = pd.DataFrame({"F": [1.0, np.nan, 2.0]}, index=["a", "b", "c"])
    frame.to_parquet(tmp_path / "a.parquet")
    for parts in (frame, tmp_path / "a.parquet"):
        assert str(values(parts)) == "[1.0, nan, 2.0]"
    assert values(written(tmp_path, "F\n1.0\n\n2.0\n")) == [1.0, 2.0]


def book_of(folder, sheets):
    """Return a file of Excel with sheets of rows."""
    book = openpyxl.Workbook()
    book.remove(book.active)
    for name, rows in sheets.items():
        sheet = book.create_sheet(name)
        for row in rows:
            sheet.append(row)
    book.save(folder / "a.xlsx")
    return folder / "a.xlsx"


def test_sheets_of_excel(tmp_path):
    """The limits file names the sheet; a message names those there are; numbers and texts of one column are read."""
    path = book_of(tmp_path, {"Cover": [["Report"]], "Data": [[], ["n", " F"], [1, 20.5], [2, "20,25"], [], [3, 7]]})
    assert values(path, sheet="Data") == [20.5, 20.25, 7.0]
    for keys, words in (({}, "sheets of the file: Cover, Data"), ({"sheet": "data"}, "did you mean 'Data'")):
        with pytest.raises(SpecError, match=words):
            values(path, **keys)
    with pytest.raises(SpecError, match="has no sheets"):
        values(written(tmp_path, "F\n1\n"), sheet="Data")


def test_formulas_that_nothing_has_computed_are_no_missing_values(tmp_path):
    path = book_of(tmp_path, {"Data": [["n", "F"], [1, "=A2*2"], [2, "=A3*2"]]})
    with pytest.raises(
        SpecError, match="row 2: =A2\\*2 is no number, nor are those of 1 more row; let the spreadsheet"
    ):
        values(path)
    assert values(path, "n") == [1.0, 2.0]
