"""A file with the columns of a campaign that questions read; it is mapped into memory, not read.

It is an Arrow file with one batch of rows, followed by its SHA-256. A truncated or changed file, or one with other
columns, is detected when it is opened, and is then built again.
"""

import hashlib
import json
import os
import tempfile
from contextlib import suppress
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from campaign.reports.samples import SampleColumns
from campaign.web.answers.growing_columns import SourcedColumns

_DIGEST = hashlib.sha256().digest_size
_NUMBER = "sample"
_KEY, _SOURCES = b"clearcap.columns", b"clearcap.sources"


def write_columns(path: Path, key: str, sourced: SourcedColumns) -> None:
    """Write a file of columns atomically, replacing an earlier one; `map_columns` must be given the same key."""
    columns = sourced.columns
    arrays = {_NUMBER: _as_it_is(pa.int64(), columns.number)}
    arrays |= {name: _as_it_is(pa.float64(), column) for name, column in columns.values.items()}
    metadata = {_KEY: key.encode(), _SOURCES: json.dumps(sourced.sources)}
    batch = pa.record_batch(list(arrays.values()), names=list(arrays)).replace_schema_metadata(metadata)
    handle, temporary = tempfile.mkstemp(suffix=".tmp", dir=path.parent)
    os.close(handle)
    try:
        with pa.OSFile(temporary, "wb") as sink, pa.ipc.new_file(sink, batch.schema) as writer:
            writer.write_batch(batch)
        with open(temporary, "r+b") as file:
            digest = hashlib.file_digest(file, "sha256").digest()
            file.write(digest)
        os.replace(temporary, path)
    except BaseException:
        with suppress(OSError):
            os.remove(temporary)
        raise


def map_columns(path: Path, key: str | None, *, just_written: bool = False) -> SourcedColumns:
    """Map a file of columns into memory and return them; the arrays are read-only.

    The key None accepts any columns. The digest of a file that this process has `just_written` is not checked. Raises
    ValueError if the file is damaged or holds other columns, OSError if it cannot be opened.
    """
    with pa.memory_map(str(path)) as source:
        content = source.read_buffer()
    end = content.size - _DIGEST
    if end <= 0 or not (just_written or _is_sound(memoryview(content), end)):
        raise ValueError(f"{path} is damaged")
    try:
        with pa.ipc.open_file(pa.BufferReader(content.slice(0, end))) as reader:
            metadata = reader.schema.metadata or {}
            if key not in (None, metadata.get(_KEY, b"").decode()) or reader.num_record_batches != 1:
                raise ValueError(f"{path} holds other columns")
            batch = reader.get_batch(0)
        arrays = {name: column.to_numpy() for name, column in zip(batch.schema.names, batch.columns, strict=True)}
    except pa.ArrowException as error:
        raise ValueError(f"{path} cannot be read: {error}") from error
    sources = {int(number): source for number, source in json.loads(metadata.get(_SOURCES, b"{}")).items()}
    return SourcedColumns(SampleColumns(arrays.pop(_NUMBER), arrays), sources)


def _is_sound(content: memoryview, end: int) -> bool:
    """Return whether a file is intact; its digest begins at byte ``end``."""
    return hashlib.sha256(content[:end]).digest() == content[end:].tobytes()


def _as_it_is(kind: pa.DataType, values: NDArray[np.generic]) -> pa.Array:
    """Return numbers as an Arrow array without copying or inspecting them, so that NaN stays NaN."""
    return pa.Array.from_buffers(kind, values.size, [None, pa.py_buffer(np.ascontiguousarray(values))])
