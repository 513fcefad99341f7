"""Tables of measurements as they come from gauges and spreadsheets: their rows, and their columns as numbers or places.

A number may have a decimal point or comma, and digits in groups of three. Where a column alone does not tell what a
point or comma means, the other columns do; where nothing does, the table is refused rather than read a thousandfold
wrong.
"""

import csv
import io
import re
import warnings
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from campaign.errors import SpecError
from engine.mechanism.faults import did_you_mean
from engine.platform.regular_file import read_regular_file
from reporting.arrays import Array

if TYPE_CHECKING:
    import pandas as pd

LARGEST_TABLE = 100_000_000  # bytes
LARGEST_UNPACKED = 500_000_000  # bytes of an Excel file's content, which is compressed
FORMATS = (".csv", ".txt", ".parquet", ".xlsx")
_SEPARATORS = ";\t,"
_MISSING = ("", "nan", "na", "n/a", "-")
_LOOKED_FOR_HEADS, _LOOKED_FOR_FORMULAS = 20, 50  # rows
_GROUP_SPACES = " \u00a0\u202f\u2009'\u2019"  # between groups of three digits, in any country
_DAY_AND_MONTH = re.compile(r"(\d{1,2})([./-])(\d{1,2})\2\d{2}(?:\d{2})?\b")
_DIGITS = re.compile(r"(\d+)")
_QUOTED = re.compile(r'"[^"]*,')
_SIMPLE = re.compile(r"[+-]?[1-9]\d{0,2}[.,]\d{3}")  # a group of three digits, or three decimals
_SPACED = re.compile(rf"[+-]?\d{{1,3}}(?:[{_GROUP_SPACES}]\d{{3}})+(?:[.,]\d*)?")
_MARKED = re.compile(r"[+-]?[\d.,]*\d[\d.,]*(?:[eE][+-]?\d+)?")


def read_parts(path: str | Path, sheet: str | None = None) -> "pd.DataFrame":
    """Return the table of a CSV file with texts, of Parquet, or of a sheet of Excel, without the rows that are empty.

    The index has each row's number in the file. SpecError: it cannot be read, or is no table.
    """
    path, suffix = Path(path), Path(path).suffix.lower()
    if suffix not in FORMATS:
        raise SpecError(f"parts {path}: its name ends in none of {', '.join(FORMATS)}; name a table of measurements")
    if sheet is not None and suffix != ".xlsx":
        raise SpecError(f'parts {path}: has no sheets; leave sheet = "{sheet:.40}" out')
    try:
        content = read_regular_file(path, LARGEST_TABLE)
        return _read(content, suffix, sheet)
    except OSError as error:
        raise SpecError(f"parts {path}: cannot be read ({error.strerror or error}); name a file") from error
    except ImportError as error:
        raise SpecError(f"parts {path}: openpyxl is not installed; pip install openpyxl") from error
    except SpecError as error:
        raise SpecError(f"parts {path}: {error}") from error
    except Exception as error:  # each reader has its own errors for a damaged file
        raise SpecError(f"parts {path}: not a table ({str(error).splitlines()[0]:.200}); correct the file") from error


def _read(content: bytes, suffix: str, sheet: str | None) -> "pd.DataFrame":
    import pandas as pd

    if suffix == ".parquet":
        return numbered(pd.read_parquet(io.BytesIO(content)))
    return _without_empty_rows(_excel(content, sheet) if suffix == ".xlsx" else _csv(content))


def numbered(table: "pd.DataFrame") -> "pd.DataFrame":
    """Return a table whose index has the numbers of its rows, from 1 on."""
    return table.set_axis(range(1, len(table) + 1), axis="index")


def _excel(content: bytes, sheet: str | None) -> "pd.DataFrame":
    """Return the cells of a sheet, by default the first; the first row with a cell names the columns."""
    import pandas as pd

    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        unpacked = sum(each.file_size for each in archive.infolist())
    if unpacked > LARGEST_UNPACKED:
        raise SpecError(f"unpacked it has {unpacked} bytes; allowed: up to {LARGEST_UNPACKED}; send CSV")
    with pd.ExcelFile(io.BytesIO(content), engine="openpyxl") as book:
        names = [str(name) for name in book.sheet_names]
        if sheet is not None and sheet not in names:
            listed = ", ".join(f"{name:.40}" for name in names[:20])
            raise SpecError(f"sheet: it has no sheet {sheet:.40}; its sheets: {listed}{did_you_mean(sheet, names)}")
        cells = pd.read_excel(book, sheet_name=sheet or names[0], header=None)
    if cells.iloc[:_LOOKED_FOR_FORMULAS].isna().to_numpy().any():
        cells = _with_formulas(cells, content, sheet or names[0])
    if cells.empty:
        others = f"; the others: {', '.join(f'{name:.40}' for name in names[1:20])}" if sheet is None else ""
        raise SpecError(f"sheet {sheet or names[0]:.40} is empty{others}; name one with measurements by sheet")
    cells.index = cells.index + 1
    cells = cells[cells.notna().any(axis="columns")]
    heads = ["" if head is None or head != head else str(head).strip() for head in cells.iloc[0]]
    table = cells.iloc[1:].infer_objects().set_axis(heads, axis="columns")
    table.attrs["sheets"] = names
    return table


def _with_formulas(cells: "pd.DataFrame", content: bytes, sheet: str) -> "pd.DataFrame":
    """Return cells with the formulas, in the first rows, of which the file has no value: no spreadsheet saved it."""
    import pandas as pd

    written = pd.read_excel(
        io.BytesIO(content), sheet_name=sheet, header=None, nrows=_LOOKED_FOR_FORMULAS, engine="openpyxl",
        engine_kwargs={"data_only": False},
    )  # fmt: skip
    written = written.reindex(index=cells.index, columns=cells.columns).astype(object)
    is_formula = written.map(lambda cell: isinstance(cell, str) and cell.startswith("=")) & cells.isna()
    return cells.astype(object).where(~is_formula, written) if is_formula.to_numpy().any() else cells


def _csv(content: bytes) -> "pd.DataFrame":
    """Return the cells of a CSV file as texts; the separator is that of its first line with text."""
    import pandas as pd

    lines = _decoded(content).splitlines(keepends=True)
    first = next((at for at, line in enumerate(lines) if line.strip()), 0)
    said = re.fullmatch(r"sep=(.)\s*", lines[first]) if lines else None  # as Excel writes it
    first += said is not None
    if first >= len(lines):
        raise SpecError("it is empty; the first line must name the columns")
    separator = said[1] if said else max(_SEPARATORS, key=lines[first].count)
    # a single column tells no separator, but quotation marks around a number with a comma do
    is_comma = separator == "," or (separator not in lines[first] and any(map(_QUOTED.match, lines[first + 1 :])))
    rows = csv.reader(lines[first:], delimiter=separator, skipinitialspace=True)
    heads = [head.strip() for head in next(rows, [])]  # a name may have several lines
    if not heads:
        raise SpecError("it is empty; the first line must name the columns")
    begin, n = first + rows.line_num + 1, len(heads)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)  # cells are left out
            table = pd.read_csv(
                io.StringIO("".join([separator.join(map(str, range(n + 1))), "\n", *lines[begin - 1 :]])),
                sep=separator, dtype=str, keep_default_na=False, skipinitialspace=True, skip_blank_lines=False,
                index_col=False,
            )  # fmt: skip
    except (pd.errors.ParserError, pd.errors.ParserWarning) as error:
        raise SpecError(_of_unequal_lines(lines[first:], first, separator, n)) from error
    if (table.iloc[:, n].fillna("").str.strip() != "").any():  # it is empty if lines end with a separator
        raise SpecError(_of_unequal_lines(lines[first:], first, separator, n))
    table = table.iloc[:, :n].set_axis(heads, axis="columns")
    table.index = table.index + begin
    table.attrs["has_commas_between_columns"] = is_comma
    return table


def _decoded(content: bytes) -> str:
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return content.decode("utf-16", "replace")  # Excel's "Unicode text"
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("cp1252", "replace")  # Excel's CSV in Western Europe


def _of_unequal_lines(lines: list[str], first: int, separator: str, heads: int) -> str:
    """Return what is wrong with a file whose lines have more cells than there are names."""
    rows = csv.reader(lines, delimiter=separator, skipinitialspace=True)
    for cells in rows:
        if any(cell.strip() for cell in cells[heads:]):
            names = "name" if heads == 1 else "names"
            words = f"line {first + rows.line_num} has {len(cells)} cells, line {first + 1} {heads} {names} of columns"
            remedy = "delete what is above the names of the columns, and cells beyond them"
            if separator == ",":
                remedy += "; if commas are decimal ones, separate the columns by semicolons"
            return f"{words}; {remedy}"
    return "its lines are no rows of cells; a quotation mark may be missing"


def _without_empty_rows(table: "pd.DataFrame") -> "pd.DataFrame":
    """Return the rows that have a value in any column: spreadsheets leave empty ones."""
    is_empty = np.ones(len(table), bool)
    for _, column in table.items():
        is_empty &= (column.isna() | (column.astype(str).str.strip() == "")).to_numpy(bool)
    return table[~is_empty]


def column_of(table: "pd.DataFrame", name: str, key: str) -> "pd.Series[Any]":
    """Return a column of the table; SpecError names the key of the limits file that asks for it."""
    there = [str(column) for column in table.columns]
    found = there.count(name)
    if found == 1:
        return table.iloc[:, there.index(name)]
    listed = ", ".join(f"{column:.40}" for column in there[:20])
    if found:
        raise SpecError(f"{key}: the table has {found} columns {name}; its columns: {listed}; rename all but one")
    words = f"{key}: the table has no column {name}; its columns: {listed}{did_you_mean(name, there[:1000])}"
    top = table.iloc[:_LOOKED_FOR_HEADS]
    for row, cells in zip(top.index, top.to_numpy(object), strict=True):
        if any(str(cell).strip() == name for cell in cells):
            words += f"; row {row} has a cell {name}: delete what is above the names of the columns"
            break
    sheets = table.attrs.get("sheets", ())
    words += f"; sheets of the file: {', '.join(f'{each:.40}' for each in sheets[:20])}" if len(sheets) > 1 else ""
    raise SpecError(words)


# -- columns become numbers --------------------------------------------------------------------------------------------


def numbers_of(table: "pd.DataFrame", columns: Mapping[str, str]) -> dict[str, Array]:
    """Return columns as numbers, NaN where a cell is empty; `columns` has the key that asks for each.

    SpecError: a cell is no number, or may be two.
    """
    import pandas as pd

    found, texts, known = dict[str, Array](), dict[str, list[str]](), dict[str, Array]()
    for name, key in columns.items():
        column = column_of(table, name, key)
        if pd.api.types.is_numeric_dtype(column) and not pd.api.types.is_bool_dtype(column):
            found[name] = column.to_numpy(float, na_value=np.nan)
        else:
            texts[name], known[name] = _texts_and_numbers(column)
    rows, marks = [int(row) for row in table.index], {name: _marks(each) for name, each in texts.items()}
    for name, each in texts.items():
        others = {mark: other for other, its in marks.items() if other != name for mark in its}
        commas = bool(table.attrs.get("has_commas_between_columns"))
        mark = _decimal_mark(name, each, rows, marks[name], others, commas)
        found[name] = np.where(np.isnan(known[name]), _numbers(name, each, rows, mark), known[name])
    return {name: found[name] for name in columns}


def _texts_and_numbers(column: "pd.Series[Any]") -> tuple[list[str], Array]:
    """Return the texts of a column, and the numbers of its cells that are no texts, NaN elsewhere."""
    numbers = np.full(len(column), np.nan)
    texts = list(map(_in_ascii, texts_of(column)))
    if column.dtype == object:
        for at, cell in enumerate(column):
            if isinstance(cell, int | float | np.number) and not isinstance(cell, bool):
                texts[at], numbers[at] = "", cell
    return texts, numbers


def _in_ascii(text: str) -> str:
    """Return a number without spaces or apostrophes between its groups of digits, with a hyphen as its minus."""
    text = text.replace("\u2212", "-")
    return re.sub(f"[{_GROUP_SPACES}]", "", text) if _SPACED.fullmatch(text) else text


def _marks(texts: list[str]) -> dict[str, int]:
    """Return the places of texts that tell what the decimal mark is, by the mark."""
    found: dict[str, int] = {}
    for at, text in enumerate(texts):
        if ("," in text or "." in text) and _MARKED.fullmatch(text) and not _SIMPLE.fullmatch(text):
            last = max(text.rfind(","), text.rfind("."))
            is_group = text.count(text[last]) > 1  # 1,234,567: the other one is the decimal mark
            found.setdefault(".,"[text[last] == "."] if is_group else text[last], at)
    return found


def _decimal_mark(
    name: str, texts: list[str], rows: list[int], marks: Mapping[str, int], others: Mapping[str, str], commas: bool
) -> str:
    """Return the decimal mark of a column; `others` has the columns that tell one, `commas` separate the columns."""
    if len(marks) > 1:
        comma, point = marks[","], marks["."]
        raise SpecError(
            f"column {name}: row {rows[comma]} has a decimal comma ({texts[comma]:.20}), row {rows[point]}"
            f" a decimal point ({texts[point]:.20}); use one of them"
        )
    if marks:
        return next(iter(marks))
    simple = next((at for at, text in enumerate(texts) if _SIMPLE.fullmatch(text)), None)
    if simple is None:
        return "."
    mark = "," if "," in texts[simple] else "."
    if any(("." if mark == "," else ",") in text and _SIMPLE.fullmatch(text) for text in texts):
        why = "points and commas are mixed"
    elif against := next((other for its, other in others.items() if its != mark), ""):
        why = f"column {against} has a decimal {'point' if mark == ',' else 'comma'}"
    elif mark not in others and any(text.lstrip("+-").isdecimal() for text in texts):
        why = "other cells have no decimals"
    elif mark == "," and mark not in others and commas:
        why = "commas separate the columns"
    else:
        return mark
    text = texts[simple].lstrip("+")
    raise SpecError(
        f"column {name}, row {rows[simple]}: {text} may be {text.replace(mark, '')} or {text.replace(mark, '.')}, as"
        f" {why}; write numbers without groups of digits, or with all their decimals"
    )


def _numbers(name: str, texts: list[str], rows: list[int], mark: str) -> Array:
    """Return texts as numbers, with a decimal mark."""
    group = "." if mark == "," else ","
    grouped = re.compile(rf"[+-]?\d{{1,3}}(?:[{group}]\d{{3}})+(?:[{mark}]\d*)?")
    values, faults = np.full(len(texts), np.nan), list[int]()
    for at, text in enumerate(texts):
        if text.lower() in _MISSING:
            continue
        plain = text.replace(group, "") if group in text and grouped.fullmatch(text) else text
        try:
            if "_" in plain or (mark == "," and "." in plain):
                raise ValueError
            values[at] = float(plain.replace(",", ".") if mark == "," else plain)
        except ValueError:
            faults.append(at)
    if faults:
        text, others = texts[faults[0]], len(faults) - 1
        more = f", nor are those of {others} more row{'s' * (others > 1)}" if others else ""
        remedy = "correct it, or leave it empty: the part then counts as a reject"
        if text.startswith(("<", ">")):
            remedy = "write the number that the gauge showed; an empty cell would count as a reject"
        elif text.startswith("="):
            remedy = "let the spreadsheet compute it, and save the file again"
        raise SpecError(f"column {name}, row {rows[faults[0]]}: {text:.40} is no number{more}; {remedy}")
    return values


def texts_of(column: "pd.Series[Any]") -> list[str]:
    """Return the cells of a column as texts, empty where there is nothing."""
    import pandas as pd

    return ["" if cell is None or cell is pd.NaT or cell != cell else str(cell).strip() for cell in column]


# -- columns become groups and places ----------------------------------------------------------------------------------


def labels_of(table: "pd.DataFrame", name: str, key: str) -> list[str]:
    """Return which lot, subgroup, part or operator each row belongs to; SpecError: a cell is empty."""
    column = column_of(table, name, key)
    texts = texts_of(column)
    if "" in texts:
        row, count = column.index[texts.index("")], texts.count("")
        others = f", as {count - 1} more cell{'s are' if count > 2 else ' is'}" * (count > 1)
        raise SpecError(
            f"{key}: column {name}, row {row} is empty{others}; rows without a {key} are not one {key}: fill it in"
        )
    return texts


def ranks_of(table: "pd.DataFrame", name: str, key: str) -> "np.ndarray[Any, np.dtype[np.intp]]":
    """Return the rows in the order of a column: of its numbers, else of its times, else of its texts; SpecError."""
    import pandas as pd

    column = column_of(table, name, key)
    rows, texts = column.index, texts_of(column)
    if "" in texts:
        raise SpecError(f"{key}: column {name}, row {rows[texts.index('')]} is empty; say when that part was made")
    try:
        numbers = numbers_of(table, {name: key})[name]
        if not np.isnan(numbers).any():
            return np.argsort(numbers, kind="stable")
    except SpecError:
        pass  # times or texts
    times = pd.to_datetime(column, errors="coerce", format="mixed", utc=True, dayfirst=_day_is_first(texts, name, key))
    is_time = times.notna().to_numpy()
    if is_time.all():
        return np.argsort(times.to_numpy(), kind="stable")
    if is_time.any():
        at = int(np.argmin(is_time))
        raise SpecError(f"{key}: column {name}, row {rows[at]}: {texts[at]:.40} is no time, as others are; correct it")
    # numbers within texts count as numbers: part 9 was made before part 10
    words = []
    for text in texts:
        parts = [(part.lstrip("0") if part.isdigit() else "", part) for part in _DIGITS.split(text)]
        words.append([(len(digits), digits) if digits else (0, part) for digits, part in parts])
    return np.array(sorted(range(len(texts)), key=words.__getitem__), np.intp)


def _day_is_first(texts: list[str], name: str, key: str) -> bool:
    """Return whether dates as 03.04.2026 or 03/04/2026 begin with the day; SpecError if nothing tells."""
    found = [match for text in texts if (match := _DAY_AND_MONTH.match(text))]
    first, second = (max((int(match[at]) for match in found), default=0) for at in (1, 3))
    if not found or first > 12 or second > 12:
        return first > 12
    if all(match[2] == "." for match in found):
        return True  # nobody writes the month first with dots
    raise SpecError(
        f"{key}: column {name}: in {found[0][0]} either number may be the month; write times as 2026-04-03 08:15"
    )
