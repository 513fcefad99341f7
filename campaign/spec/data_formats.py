"""Columns in the content of a CSV or Parquet file, decoded only after their size has been checked."""

import csv
import io
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from campaign.errors import SpecError
from campaign.footers.column_chunks import column_chunks

if TYPE_CHECKING:
    import pyarrow as pa

MOST_ROWS = 1_000_000
MOST_COLUMNS = 1000
LONGEST_HEADER = 100_000  # bytes of a CSV file's first line
LARGEST_COLUMN = 64_000_000  # bytes, decoded: eight times what the most rows take, to allow for any encoding
LARGEST_DECODED = 1 << 30  # bytes that decoding may take
BATCH = 65_536  # rows decoded at a time


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
