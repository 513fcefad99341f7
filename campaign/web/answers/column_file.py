"""One file with the columns of a campaign that questions read: it is mapped into memory, not read.

It is an Arrow file with one batch of rows, and the SHA-256 of it behind. A file that is cut short, changed or another's
is found out when it is opened, and so costs no more than building it again.
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
    """Write a file of columns, whole or not at all, replacing an earlier one.

    Parameters
    ----------
    path : Path
        The file.
    key : str
        What the columns are; who opens the file must ask for the same.
    sourced : SourcedColumns
        The columns, and what they come from.

    Raises
    ------
    OSError
        If it cannot be written.
    """
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
    """Return the columns in a file; their memory is the file's, and cannot be written.

    Parameters
    ----------
    path : Path
        The file.
    key : str or None
        What the columns must be; None: anything.
    just_written : bool
        This process has written the file a moment ago: its digest is not checked.

    Raises
    ------
    OSError
        If it cannot be opened.
    ValueError
        If it is damaged, or holds other columns.
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
    """Return whether a file is as it was written: its digest follows from byte ``end`` on."""
    return hashlib.sha256(content[:end]).digest() == content[end:].tobytes()


def _as_it_is(kind: pa.DataType, values: NDArray[np.generic]) -> pa.Array:
    """Return numbers as an Arrow array, without a copy or a look at each: NaN stays NaN."""
    return pa.Array.from_buffers(kind, values.size, [None, pa.py_buffer(np.ascontiguousarray(values))])
