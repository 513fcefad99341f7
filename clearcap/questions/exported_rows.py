"""Rows of a campaign as Arrow, Parquet or CSV, generated while they are sent, some ten thousand rows at a time."""

import io
import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.parquet as pq

from campaign.errors import SpecError
from campaign.plan import Plan
from campaign.row_build import clearcap_version
from campaign.store import Store

# The media type of each format.
FORMATS = {
    "arrow": "application/vnd.apache.arrow.stream",
    "parquet": "application/vnd.apache.parquet",
    "csv": "text/csv; charset=utf-8",
}
_FORMULAS = ("=", "+", "-", "@", "\t", "\r")  # how a spreadsheet's formula may begin


@dataclass(frozen=True)
class RowSelection:
    """A selection of rows and columns."""

    columns: tuple[str, ...] = ()  # in this order; empty selects all
    first: int | None = None  # smallest sample number
    last: int | None = None  # largest sample number
    statuses: tuple[str, ...] = ()  # of the runs; empty selects all


def rows_etag(version: str, kind: str, selection: RowSelection) -> str:
    """Return the ETag of an export, in quotes: a digest of rows, format, selection, and versions of the software."""
    import hashlib

    made_of = repr((version, kind, selection, pa.__version__, clearcap_version()))
    return f'"{hashlib.sha256(made_of.encode("utf-8", "surrogateescape")).hexdigest()[:32]}"'


def export_rows(store: Store, plan: Plan, kind: str, selection: RowSelection = RowSelection()) -> Iterator[bytes]:
    """Return the bytes of a file of rows, in the order of the samples, as an iterator of pieces; skip missing batches.

    The first piece is generated before this function returns, so that errors are raised before anything is sent; only
    StoreError may come later. ``arrow`` is a stream of batches, not a file; it and ``parquet`` keep the units in the
    metadata of the columns. Raises SpecError if there is no such format or column, a column is named twice, or the
    range is empty.
    """
    if kind not in FORMATS:
        raise SpecError(f"format {kind}: unknown; allowed: {', '.join(FORMATS)}")
    names = list(selection.columns) or plan.schema.names
    for name in names:
        if name not in plan.schema.names:
            allowed = ", ".join(plan.schema.names)
            raise SpecError(f"column {name}: campaign {plan.campaign_id} has none; allowed: {allowed}")
    if len(set(names)) < len(names):
        raise SpecError(f"columns {', '.join(names)}: one is named twice; name each once")
    if selection.first is not None and selection.last is not None and selection.first > selection.last:
        raise SpecError(f"samples {selection.first} to {selection.last}: there are none; exchange the ends")
    pieces = _pieces(store, plan, kind, names, selection)
    return chain([next(pieces)], pieces)


def _pieces(store: Store, plan: Plan, kind: str, names: list[str], selection: RowSelection) -> Iterator[bytes]:
    schema = pa.schema([plan.schema.field(name) for name in names], plan.schema.metadata)
    sent = SentBytes()
    with _writer(kind, sent, schema) as writer:
        yield sent.taken()
        for table in _selected(store, plan, names, selection):
            writer.write_table(table.cast(schema))
            yield sent.taken()
    yield sent.taken()


def _selected(store: Store, plan: Plan, names: list[str], selection: RowSelection) -> Iterator[pa.Table]:
    """Yield the selected rows and columns; reading stops after the last sample."""
    read = list(dict.fromkeys(["sample", *(["status"] if selection.statuses else []), *names]))
    for table in store.stream(plan, read):
        numbers = table["sample"].to_numpy()
        wanted = numbers >= (0 if selection.first is None else selection.first)
        if selection.last is not None:
            wanted &= numbers <= selection.last
        if selection.statuses:
            wanted &= pa.compute.is_in(table["status"], pa.array(selection.statuses, pa.string())).to_numpy()
        if wanted.any():
            chosen = table if wanted.all() else table.filter(pa.array(wanted))
            yield chosen.select(names).combine_chunks()
        if selection.last is not None and numbers.size and numbers[-1] >= selection.last:
            return


class SentBytes(io.RawIOBase):
    """A file whose bytes are kept until they are sent; it cannot seek, so no byte changes after it was sent."""

    def __init__(self) -> None:
        super().__init__()
        self._written, self._size = bytearray(), 0

    def writable(self) -> bool:
        """Return True."""
        return True

    def write(self, content: Any) -> int:
        """Keep bytes; return their number."""
        self._written += content
        self._size += len(content)
        return len(content)

    def tell(self) -> int:
        """Return the number of bytes written in total."""
        return self._size

    def taken(self) -> bytes:
        """Return the bytes written since the last call, even after the file was closed."""
        content = bytes(self._written)
        self._written.clear()
        return content


class _CsvWriter:
    """A writer of CSV whose texts no spreadsheet takes for formulas: such a one gets an apostrophe in front."""

    def __init__(self, file: pa.PythonFile, schema: pa.Schema) -> None:
        names = (f"'{name}" if name.startswith(_FORMULAS) else name for name in schema.names)
        self._schema = pa.schema([field.with_name(n) for field, n in zip(schema, names, strict=True)], schema.metadata)
        self._writer = pyarrow.csv.CSVWriter(file, self._schema)

    def __enter__(self) -> "_CsvWriter":
        return self

    def __exit__(self, *error: Any) -> None:
        self._writer.close()

    def write_table(self, table: pa.Table) -> None:
        """Write some rows."""
        formula = f"^([{re.escape(''.join(_FORMULAS))}])"
        columns = [
            pc.replace_substring_regex(column, formula, r"'\1") if pa.types.is_string(column.type) else column
            for column in table.columns
        ]
        self._writer.write_table(pa.table(columns, schema=self._schema))


def _writer(kind: str, sink: SentBytes, schema: pa.Schema) -> Any:
    """Return a writer of tables in a format, for a ``with`` block."""
    file = pa.PythonFile(sink, "w")
    if kind == "arrow":
        return pa.ipc.new_stream(file, schema)
    return pq.ParquetWriter(file, schema, compression="zstd") if kind == "parquet" else _CsvWriter(file, schema)
