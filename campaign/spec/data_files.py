"""Data files beside a campaign file: their values become part of the campaign when it is loaded.

Columns of a CSV or Parquet file are decoded only after their size has been checked.
"""

import csv
import io
import re
import resource
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any, TypeGuard

import numpy as np

from campaign.errors import SpecError
from campaign.parquet_footer import column_chunks
from campaign.spec.faults import SpecFault, fault
from campaign.spec.named_files import NamedFiles
from engine.mechanism.faults import did_you_mean

if TYPE_CHECKING:
    import pyarrow as pa

LARGEST_FILE = 100_000_000  # bytes
MOST_ROWS = 1_000_000
MOST_COLUMNS = 1000
LONGEST_HEADER = 100_000  # bytes of a CSV file's first line
LARGEST_COLUMN = 64_000_000  # bytes, decoded: eight times what the most rows take, to allow for any encoding
LARGEST_DECODED = 1 << 30  # bytes that decoding may take
BATCH = 65_536  # rows decoded at a time
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


# -- formats -----------------------------------------------------------------------------------------------------------


class CsvColumns:
    """The columns in the content of a CSV file; `names` has the names of all.

    Raises SpecError if there are too many rows or columns.
    """

    def __init__(self, content: bytes) -> None:
        start = content[:LONGEST_HEADER]
        if len(content) > LONGEST_HEADER and b"\n" not in start and b"\r" not in start:
            raise SpecError(f"its first line has more than {LONGEST_HEADER} bytes; keep only the columns that you need")
        lines = csv.reader(io.StringIO(start.decode("utf-8-sig", "replace"), newline=""))
        try:
            self.names = next(filter(None, lines), [])
        except csv.Error as error:
            raise SpecError(f"not csv: its first line cannot be read ({error}); correct the file") from error
        check_size(len(self.names), MOST_COLUMNS, "columns")
        # lines end with \n, \r\n or \r; one more than rows, for the header
        check_size(max(content.count(b"\n"), content.count(b"\r")), MOST_ROWS + 1, "lines")
        self._content = content

    def read(self, names: list[str]) -> "pa.Table":
        """Return the named columns; pyarrow.ArrowException if the file is not CSV."""
        import pyarrow as pa
        from pyarrow import csv as arrow

        options = arrow.ConvertOptions(include_columns=names)
        return arrow.read_csv(pa.BufferReader(self._content), convert_options=options)


class ParquetColumns:
    """The columns in the content of a Parquet file; `names` has the names of all.

    A page of a few bytes may decode to gigabytes. The sizes that the footer states are checked before anything is
    decoded. As the footer may be wrong, no more rows than allowed are decoded, in `bounded_memory`. Raises SpecError if
    there are too many rows or columns; pyarrow.ArrowException, OSError or ValueError if the file is not Parquet, or is
    damaged.
    """

    def __init__(self, content: bytes) -> None:
        import pyarrow as pa
        from pyarrow import parquet

        self._file, self._content = parquet.ParquetFile(pa.BufferReader(content)), content
        self.names: list[str] = self._file.schema_arrow.names
        check_size(self._file.metadata.num_columns, MOST_COLUMNS, "columns")
        check_size(self._file.metadata.num_rows, MOST_ROWS, "rows")

    def read(self, names: list[str]) -> "pa.Table":
        """Return the named columns; raises the same errors as the class."""
        import pyarrow as pa

        schema = self._file.schema_arrow
        empty = pa.schema([schema.field(name) for name in names]).empty_table()
        if not all(is_number(kind) for kind in empty.schema.types):
            return empty  # the caller refuses columns of this type
        for chunk in column_chunks(self._content):
            if chunk.path in names:
                check_size(chunk.values, MOST_ROWS, "values")
                check_size(chunk.uncompressed, LARGEST_COLUMN, "bytes in a column")
        tables, rows = [empty], 0
        for batch in self._file.iter_batches(BATCH, columns=names, use_threads=False):
            rows += batch.num_rows
            check_size(rows, MOST_ROWS, "rows")
            tables.append(pa.table(batch).select(names))
        return pa.concat_tables(tables)


@contextmanager
def bounded_memory() -> Iterator[None]:
    """Make allocations in the block fail with MemoryError beyond the memory that decoding a data file may take."""
    try:
        # data and stack [pages], see proc(5): what RLIMIT_DATA limits
        in_use = int(Path("/proc/self/statm").read_text().split()[5]) * resource.getpagesize()
    except OSError:  # an operating system without /proc
        yield
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    limits = [limit for limit in (soft, hard, in_use + LARGEST_DECODED) if limit != resource.RLIM_INFINITY]
    resource.setrlimit(resource.RLIMIT_DATA, (min(limits), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


def is_number(kind: "pa.DataType") -> bool:
    """Return whether values of an Arrow type are numbers."""
    import pyarrow as pa

    return bool(pa.types.is_integer(kind) or pa.types.is_floating(kind))


def check_size(count: int, most: int, what: str) -> None:
    """Raise SpecError if a file holds more of something than any campaign needs."""
    if count > most:
        raise SpecError(f"more than {most} {what} ({count}); keep only what the campaign needs")
