"""Data files beside a campaign file: their values become part of the campaign when it is loaded."""

import re
from collections.abc import Iterable, Mapping
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, TypeGuard

import numpy as np

from campaign.errors import SpecError
from campaign.spec.data_formats import CsvColumns, ParquetColumns, bounded_memory, is_number
from campaign.spec.faults import SpecFault, fault
from campaign.spec.named_files import NamedFiles
from engine.mechanism.faults import did_you_mean

if TYPE_CHECKING:
    import pyarrow as pa

LARGEST_FILE = 100_000_000  # bytes
FORMATS = (".csv", ".parquet")


def read_data_files(raw: Mapping[str, Any], files: NamedFiles) -> tuple[dict[str, Any], list[SpecFault]]:
    """Return a campaign with the columns of its data files in place of their names, and the faults of the files.

    The campaign is as read, and may have other faults; a table whose file cannot be read is unchanged.
    """
    whole, faults = dict(raw), list[SpecFault]()
    variables, table = raw.get("variables"), raw.get("table")
    if isinstance(variables, dict):
        whole["variables"] = dict(variables)
        for name, entry in variables.items():
            if not _names_file(entry, "values") or not isinstance(entry.get("column"), str):
                continue
            try:
                values = read_columns(files, entry["file"], [entry["column"]])[entry["column"]]
                rest = {key: value for key, value in entry.items() if key not in ("file", "column")}
                origin = f"{entry['file']}, column {entry['column']}"
                whole["variables"][name] = {"source": origin, **rest, "values": values}
            except SpecError as error:
                faults.append(fault(["variables", name, "file"], entry["file"], str(error)))
    if _names_file(table, "columns") and isinstance(variables, dict):
        try:
            columns = read_columns(files, table["file"], list(variables))
            rest = {key: value for key, value in table.items() if key != "file"}
            whole["table"] = {"source": table["file"], **rest, "columns": columns}
        except SpecError as error:
            faults.append(fault(["table", "file"], table["file"], str(error)))
    return whole, faults


def read_columns(files: NamedFiles, file: str, names: list[str]) -> dict[str, list[float]]:
    """Return columns of numbers from a CSV or Parquet file, by name.

    Raises SpecError, which does not name the key, if the file cannot be read, lacks a column, has too many rows, or
    holds anything but finite numbers.
    """
    import pyarrow as pa

    suffix = PurePath(file).suffix.lower()
    if suffix not in FORMATS:
        raise SpecError("its name ends neither in .csv nor in .parquet; name a CSV or Parquet file")
    content = files.content(file, LARGEST_FILE)
    try:
        with bounded_memory():
            columns = (CsvColumns if suffix == ".csv" else ParquetColumns)(content)
            if columns.names:  # otherwise read() reports what is wrong
                _check_names(names, columns.names, files.may_quote(file))
            table = columns.read(names)
    except MemoryError as error:
        raise SpecError("its content takes too much memory; keep only the columns and rows that you need") from error
    except (pa.ArrowException, OverflowError, ValueError) as error:  # ValueError: a damaged footer
        raise SpecError(f"not {suffix[1:]}: {_reason(error)}; correct the file") from error
    except OSError as error:
        what = error.strerror if error.errno else _reason(error)  # pyarrow's own errors have no number
        raise SpecError(f"cannot be read ({what}); name a readable {suffix[1:]} file") from error
    return {name: _numbers(table.column(name), name) for name in names}


def _names_file(entry: Any, content: str) -> TypeGuard[dict[str, Any]]:
    """Return whether a table names a file instead of having its content under the key ``content``."""
    return (
        isinstance(entry, dict) and isinstance(entry.get("file"), str) and entry["file"] != "" and content not in entry
    )


def _check_names(names: Iterable[str], there: list[str], quote: bool) -> None:
    """Refuse a file unless it has exactly one column of each name."""
    for name in names:
        if (count := there.count(name)) != 1:
            what = f"no column {name}" if count == 0 else f"{count} columns {name}"
            some = ", ".join(f"{column:.40}" for column in there[:20]) + (", ..." if len(there) > 20 else "")
            columns = f"columns: {some}{did_you_mean(name, there[:1000])}" if quote else f"it has {len(there)} others"
            raise SpecError(f"{what}; {columns}")


def _reason(error: BaseException) -> str:
    """Return pyarrow's reason in one line, without the row that it quotes, as a campaign may name any file."""
    line = next(iter(str(error).splitlines()), "") or type(error).__name__
    return re.sub(r"(, got \d+|invalid value).*", r"\1", line)[:200]


def _numbers(column: "pa.ChunkedArray", name: str) -> list[float]:
    """Return a column as finite numbers."""
    import pyarrow as pa

    if not is_number(column.type):
        raise SpecError(
            f"column {name} holds {column.type}; it must hold numbers, with a decimal point and without units"
        )
    values = column.cast(pa.float64(), safe=False).to_numpy()  # nulls become NaN
    wrong = np.flatnonzero(~np.isfinite(values))
    if values.size == 0:
        raise SpecError(f"column {name} is empty; it must hold at least one number")
    if wrong.size:
        raise SpecError(
            f"column {name}, row {wrong[0] + 1} of {values.size}: no finite number, as in {wrong.size - 1} other rows;"
            " complete or remove these rows"
        )
    numbers: list[float] = values.tolist()
    return numbers
