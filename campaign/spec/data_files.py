"""Data files beside a campaign file: their values become part of the campaign when it is loaded."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeGuard

import numpy as np

from campaign.errors import SpecError
from campaign.spec.faults import fault
from engine.mechanism.faults import did_you_mean

if TYPE_CHECKING:
    import pyarrow as pa

LARGEST_FILE = 100_000_000  # bytes
FORMATS = (".csv", ".parquet")


def read_data_files(raw: Mapping[str, Any], folder: Path) -> tuple[dict[str, Any], list[str]]:
    """Return a campaign in which the columns of its data files replace the names of the files.

    Parameters
    ----------
    raw : mapping
        The campaign as read. It may have faults.
    folder : Path
        The folder that relative paths start from.

    Returns
    -------
    dict
        The campaign; a table whose file cannot be read is left as it was.
    list of str
        What is wrong with the files, one line for each fault.
    """
    whole, faults = dict(raw), []
    variables, table = raw.get("variables"), raw.get("table")
    if isinstance(variables, dict):
        whole["variables"] = dict(variables)
        for name, entry in variables.items():
            if not _names_file(entry, "values") or not isinstance(entry.get("column"), str):
                continue
            try:
                values = read_columns(folder / entry["file"], [entry["column"]])[entry["column"]]
                rest = {key: value for key, value in entry.items() if key not in ("file", "column")}
                origin = f"{entry['file']}, column {entry['column']}"
                whole["variables"][name] = {"source": origin, **rest, "values": values}
            except SpecError as error:
                faults.append(fault(["variables", name, "file"], entry["file"], str(error)))
    if _names_file(table, "columns") and isinstance(variables, dict):
        try:
            columns = read_columns(folder / table["file"], list(variables))
            rest = {key: value for key, value in table.items() if key != "file"}
            whole["table"] = {"source": table["file"], **rest, "columns": columns}
        except SpecError as error:
            faults.append(fault(["table", "file"], table["file"], str(error)))
    return whole, faults


def read_columns(path: Path, names: list[str]) -> dict[str, list[float]]:
    """Return columns of numbers of a CSV or Parquet file by name.

    Parameters
    ----------
    path : Path
        The file.
    names : list of str
        The columns to read.

    Raises
    ------
    SpecError
        If the file cannot be read, lacks a column, or holds anything but finite numbers. The message lacks the key.
    """
    content = _read(path)
    columns = {}
    for name in names:
        count = content.column_names.count(name)
        if count != 1:
            what = f"no column {name}" if count == 0 else f"{count} columns {name}"
            raise SpecError(
                f"{what}; columns: {', '.join(content.column_names)}{did_you_mean(name, content.column_names)}"
            )
        columns[name] = _numbers(content.column(name), name)
    return columns


def _names_file(entry: Any, content: str) -> TypeGuard[dict[str, Any]]:
    """Return whether a table names a file instead of having its content under the key ``content``."""
    return (
        isinstance(entry, dict) and isinstance(entry.get("file"), str) and entry["file"] != "" and content not in entry
    )


def _read(path: Path) -> "pa.Table":
    """Return a file as a table."""
    import pyarrow as pa
    from pyarrow import csv, parquet

    if path.suffix.lower() not in FORMATS:
        raise SpecError("its name ends neither in .csv nor in .parquet; name a CSV or Parquet file")
    try:
        if not path.is_file():
            raise SpecError(f"no such file ({path}); paths are relative to the campaign file")
        if path.stat().st_size > LARGEST_FILE:
            raise SpecError(
                f"larger than {LARGEST_FILE // 1_000_000} MB; keep only the columns and rows that the campaign needs"
            )
        return csv.read_csv(path) if path.suffix.lower() == ".csv" else parquet.read_table(path)
    except (pa.ArrowInvalid, pa.ArrowKeyError) as error:
        raise SpecError(f"not {path.suffix.lower()[1:]}: {str(error).splitlines()[0]}; correct the file") from error
    except OSError as error:
        raise SpecError(f"cannot be read ({error.strerror or error}); name a readable file") from error


def _numbers(column: "pa.ChunkedArray", name: str) -> list[float]:
    """Return a column as finite numbers."""
    import pyarrow as pa

    if not (pa.types.is_integer(column.type) or pa.types.is_floating(column.type)):
        raise SpecError(
            f"column {name} holds {column.type}; it must hold numbers, with a decimal point and without units"
        )
    values = column.cast(pa.float64()).to_numpy()  # nulls become NaN
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
