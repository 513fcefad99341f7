"""A private folder with the columns of campaigns, one memory-mapped file each; it may be deleted at any time."""

import fcntl
import hashlib
import json
import logging
import os
import tempfile
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from campaign.errors import SpecError
from campaign.plan import Plan
from campaign.samples import SampleColumns, column_names, columns_read, no_samples, samples_in
from campaign.store import Store
from campaign.store.parts import folder
from campaign.store.rows import holders
from engine import FolderError
from engine.platform.private_folder import private_folder

Sources = Mapping[int, str]  # for each batch with files, a digest of their names and stamps
_DIGEST = hashlib.sha256().digest_size
_NUMBER = "sample"
_KEY, _SOURCES = b"clearcap.columns", b"clearcap.sources"
USUAL_SIZE = 4 << 30  # bytes; enough for thirty campaigns of a million rows
ABANDONED_AFTER = 3600.0  # s; no file takes this long to write
_ENDING = ".columns"
logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class SourcedColumns:
    """Columns and their sources."""

    columns: SampleColumns  # sorted by number of sample
    sources: Sources  # see `sources_of`


def columns_folder() -> Path:
    """Return the folder of the columns below the user's cache folder, which is ``XDG_CACHE_HOME`` or ``~/.cache``."""
    try:
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser())
        return private_folder(cache, "clearcap", "columns")
    except (FolderError, OSError, RuntimeError) as error:  # RuntimeError: this user has no home folder
        raise SpecError(
            f"the columns of campaigns cannot be kept: {error}; name a folder in which only you can write with"
            " XDG_CACHE_HOME"
        ) from error


class ColumnCache:
    """Columns of campaigns in a private folder; beyond `at_most` bytes the least recently used go."""

    def __init__(self, folder: Path, at_most: int = USUAL_SIZE) -> None:
        self._folder, self._at_most = folder, at_most

    def columns(self, store: Store, plan: Plan, version: str) -> SampleColumns:
        """Return the columns of a `rows_version`; only rows whose parts have changed are read from the store."""
        place = hashlib.sha256(f"{store.url}\n{plan.campaign_id}".encode()).hexdigest()[:16]
        path = self._folder / f"{place}-{version[:32]}{_ENDING}"
        # if several processes need the same columns, one of them builds them; there are only sixteen locks, which stay
        with open(self._folder / f"{place[0]}.lock", "wb") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if (kept := self._kept(path, version)) is not None:
                return kept.columns
            others = [other for other in self._folder.glob(f"{place}-*{_ENDING}") if other != path]
            earlier = next(filter(None, (self._kept(other, None) for other in (*others, path))), None)
            sourced = grown_columns(store, plan, earlier)
            try:
                write_columns(path, version, sourced)
            except OSError as error:
                logger.warning("the columns of %s are not kept: %s", plan.campaign_id, error.strerror or error)
                return sourced.columns
            for other in others:  # a process that has mapped one can still read it
                other.unlink(missing_ok=True)
            self._remove_oldest()
            # mapped columns take no memory of this process, so that of the columns read from the store is freed
            return map_columns(path, version, just_written=True).columns if path.exists() else sourced.columns

    def _kept(self, path: Path, version: str | None) -> SourcedColumns | None:
        """Return the columns in a file; None if the file is missing or damaged."""
        try:
            sourced = map_columns(path, version)
            os.utime(path)  # its last use, by which `_remove_oldest` sorts
        except FileNotFoundError:
            return None
        except (OSError, ValueError) as error:
            logger.warning("the columns are built again: %s", error)
            return None
        return sourced

    def _remove_oldest(self) -> None:
        """Remove the least recently used files until the rest is small enough, and leftovers of killed processes."""
        found = []
        for path in self._folder.iterdir():
            with suppress(FileNotFoundError):
                status = path.stat()
                if path.suffix == ".tmp" and time.time() - status.st_mtime > ABANDONED_AFTER:
                    path.unlink()
                elif path.suffix == _ENDING:
                    found.append((status.st_mtime, path, status.st_size))
        total = sum(size for *_, size in found)
        for _, path, size in sorted(found):
            if total <= self._at_most:
                return
            path.unlink(missing_ok=True)
            total -= size


# -- the file: it is mapped into memory, not read ---------------------------------------------------------------------
#
# It is an Arrow file with one batch of rows, followed by its SHA-256. A truncated or changed file, or one with other
# columns, is detected when it is opened, and is then built again.


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
    """Map a file of columns into memory, read-only; ValueError if it is damaged or has another key (None: any)."""
    with pa.memory_map(str(path)) as source:
        content = source.read_buffer()
    end, view = content.size - _DIGEST, memoryview(content)
    if end <= 0 or not (just_written or hashlib.sha256(view[:end]).digest() == view[end:].tobytes()):
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


def _as_it_is(kind: pa.DataType, values: NDArray[np.generic]) -> pa.Array:
    """Return numbers as an Arrow array without copying or inspecting them, so that NaN stays NaN."""
    return pa.Array.from_buffers(kind, values.size, [None, pa.py_buffer(np.ascontiguousarray(values))])


# -- growth: the columns of a running campaign get the rows that were stored since the last look -----------------------
#
# The source of each batch's rows is kept beside the columns. Batches with an unchanged source have unchanged rows; only
# the other batches are read from the store. The columns are bit for bit those that reading all rows would give.


def grown_columns(store: Store, plan: Plan, earlier: SourcedColumns | None) -> SourcedColumns:
    """Return the current columns of a campaign; what has not changed is taken from an earlier result."""
    sources = sources_of(store, plan)  # before the rows, so that batches replaced meanwhile are read again next time
    kept = {} if earlier is None or list(earlier.columns.values) != column_names(plan) else earlier.sources
    same = {batch for batch, source in kept.items() if sources.get(batch) == source}
    columns = samples_in(plan, store.stream(plan, columns_read(plan), sources.keys() - same))
    if earlier is not None and same:
        columns = _merged(plan, earlier.columns, same, columns)
    if not columns.number.size:
        raise no_samples(plan)
    return SourcedColumns(columns, sources)


def sources_of(store: Store, plan: Plan) -> Sources:
    """Return for each batch a digest of its rows' source: the files with their stamps, and the end of the table."""
    stamps, end = store.files.stamps(folder(plan)), store.end(plan)
    sources = {}
    for batch, names in sorted(holders(plan, stamps).items()):
        first, count = plan.batches[batch]
        source = f"{max(0, min(count, end - first))} {[(name, stamps[name]) for name in names]}"
        sources[batch] = hashlib.sha256(source.encode()).hexdigest()[:16]
    return sources


def _merged(plan: Plan, earlier: SampleColumns, batches: set[int], others: SampleColumns) -> SampleColumns:
    """Return the samples of some batches of an earlier result, and others, sorted by number."""
    kept = np.isin(plan.batch_numbers(earlier.number), sorted(batches))
    number = np.concatenate([earlier.number[kept], others.number])
    order = np.argsort(number, kind="stable")
    values = {name: np.concatenate([x[kept], others.values[name]])[order] for name, x in earlier.values.items()}
    return SampleColumns(number[order], values)
