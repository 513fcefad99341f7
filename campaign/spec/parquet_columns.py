"""Columns of numbers in a Parquet file that anybody may have written, as a child process reads them.

Pyarrow ends the process that reads some damaged files, and a page of a few bytes may decode to gigabytes. This module
imports nothing else of the project that takes time, as it is imported for each campaign with such a file.
"""

import json
from collections.abc import Callable

import pyarrow as pa
from pyarrow import parquet

from campaign.errors import SpecError

MOST_ROWS = 1_000_000
MOST_COLUMNS = 1000
BATCH = 65_536  # rows decoded at a time


def read(request: bytes, send: Callable[[str, bytes], None]) -> None:
    """Send the names of all columns, and the values of the named ones as float64, if each is there once."""
    # The request is a list of names as JSON, a line feed, and the content of the file.
    at = request.index(b"\n")
    names: list[str] = json.loads(request[:at])
    file = parquet.ParquetFile(pa.BufferReader(pa.py_buffer(request).slice(at + 1)))
    there = file.schema_arrow
    check_size(len(there.names), MOST_COLUMNS, "columns")
    check_size(file.metadata.num_rows, MOST_ROWS, "rows")
    send("names", json.dumps(there.names).encode())
    if any(there.names.count(name) != 1 for name in names):
        return
    for name in names:
        check_type(name, there.field(name).type)
    wanted = pa.schema([(name, pa.float64()) for name in names])
    batches = file.iter_batches(BATCH, columns=names, use_threads=False)
    table = pa.concat_tables(
        [wanted.empty_table(), *(pa.table(batch).select(names).cast(wanted, safe=False) for batch in batches)]
    )
    check_size(table.num_rows, MOST_ROWS, "rows")
    for column in table.columns:
        send("column", column.to_numpy().tobytes())  # nulls become NaN


def is_number(kind: pa.DataType) -> bool:
    """Return whether values of an Arrow type are numbers."""
    return bool(pa.types.is_integer(kind) or pa.types.is_floating(kind))


def check_size(count: int, most: int, what: str) -> None:
    """Raise SpecError if a file holds more of something than any campaign needs."""
    if count > most:
        raise SpecError(f"more than {most} {what} ({count}); keep only what the campaign needs")


def check_type(name: str, kind: pa.DataType) -> None:
    """Raise SpecError unless a column holds numbers."""
    if not is_number(kind):
        raise SpecError(f"column {name} holds {kind}; it must hold numbers, with a decimal point and without units")
