"""Parts, the files of rows: their names, their content, the seal that shows that a file is sound, and their survey.

Each part is a Parquet file with a seal in its metadata: campaign, samples, columns, statuses, and a SHA-256 over the
whole file. So every file proves by itself that it is complete, and rows are counted without reading them. A merged file
holds the rows of several batches and is otherwise the same.

A survey finds out which parts of a plan a store holds, from a listing, the manifest, and the files that the manifest
lacks.
"""

import hashlib
import io
import json
import logging
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

from campaign.errors import StoreError, file_gone
from campaign.plan_header import PlanHeader
from campaign.store.files.files import Files, OddFile
from campaign.store.layout import manifest_name

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq

ROW_GROUP = 10_000  # rows; the least that a reader of a merged file holds in memory
FEW_STRINGS = ("status", "message", "earlier_attempts")  # columns of few distinct values, each written once
SEAL = "clearcap.seal"  # key of the metadata
_HEAD = b'{"clearcap":1,"sha256":"'
_UNSEALED = b"0" * 64  # stands for the digest while the digest is computed
_PART = re.compile(r"part-(\d{6,9})\.parquet")
_MERGED = re.compile(r"rows-(\d{6,9})-(\d{6,9})\.parquet")
LARGEST_DECODED = 2**30  # bytes: thirty times what the largest merged file takes
MANIFEST_FORMAT = 1
READERS = 8  # files read at a time

logger = logging.getLogger(__name__)


class BadPart(Exception):
    """A file of rows is not what its name says; the message gives the reason."""


@dataclass(frozen=True)
class Part:
    """The rows of one batch in the store."""

    batch: int
    rows: int
    statuses: dict[str, int]  # number of rows by status
    size: int  # of the file that holds them [bytes]
    sha256: str  # in the seal of that file
    # first and last batch of the merged file that holds them; None if the batch has a file of its own
    merged: tuple[int, int] | None = None

    @property
    def file(self) -> str:
        """Name of the file, relative to the folder of the parts."""
        return file_name(*(self.merged or (self.batch, self.batch)), merged=self.merged is not None)


def folder(plan: PlanHeader) -> str:
    """Return the folder of a campaign's parts, relative to the store."""
    return f"{plan.campaign_id}/{plan.folder}"


def part_name(plan: PlanHeader, batch: int) -> str:
    """Return the name of a batch's own part, relative to the store."""
    return f"{folder(plan)}/{file_name(batch, batch)}"


def file_name(first: int, last: int, *, merged: bool = False) -> str:
    """Return the name of the file of batches ``first`` to ``last``, relative to the folder of the parts."""
    return f"rows-{first:06d}-{last:06d}.parquet" if merged else f"part-{first:06d}.parquet"


def batches_of(name: str, plan: PlanHeader) -> tuple[int, int] | None:
    """Return the first and last batch in a file of this name; None if it is not the name of a file of this plan."""
    if match := _PART.fullmatch(name):
        first = last = int(match[1])
    elif match := _MERGED.fullmatch(name):
        first, last = int(match[1]), int(match[2])
    else:
        return None
    sound = first <= last < len(plan.batches) and name == file_name(first, last, merged=name.startswith("rows"))
    return (first, last) if sound else None


def encode(plan: PlanHeader, table: "pa.Table", first: int, last: int) -> bytes:
    """Return the content of the file of batches ``first`` to ``last``; ValueError if these are not their rows."""
    import pyarrow.parquet as pq

    rows = table if table.schema.equals(plan.schema, check_metadata=True) else table.cast(plan.schema)
    buffer = io.BytesIO()
    seal = {
        "campaign": plan.sealed_as,
        "columns": plan.columns,
        "first": plan.batches[first][0],
        "statuses": _statuses(plan, rows, first, last),
    }
    codec = "lz4" if first == last else "zstd"  # for the few rows of a batch zstd is no smaller, but three times slower
    writer = pq.ParquetWriter(
        buffer, plan.schema, compression=codec, use_dictionary=list(FEW_STRINGS), write_statistics=False
    )
    with writer:
        writer.write_table(rows, row_group_size=ROW_GROUP)
        writer.add_key_value_metadata({SEAL: (_HEAD + _UNSEALED).decode() + '",' + json.dumps(seal)[1:]})
    content = buffer.getbuffer()
    # the last one is the seal, which is in the footer: a text of the rows may hold these bytes too
    digest_at = bytes(content).rindex(_HEAD) + len(_HEAD)
    content[digest_at : digest_at + len(_UNSEALED)] = hashlib.sha256(content).hexdigest().encode()
    return bytes(content)


def check(plan: PlanHeader, content: bytes, first: int, last: int, *, merged: bool) -> list[Part]:
    """Return the parts of batches ``first`` to ``last`` in the content of their file; BadPart if it is damaged."""
    digest, seal = read_seal(content)
    begin, batches = plan.batches[first][0], plan.batches[first : last + 1]
    if seal["campaign"] != plan.sealed_as:
        raise BadPart(f"belongs to campaign {str(seal['campaign'])[:100]}")
    if seal["columns"] != plan.columns:
        raise BadPart("has other columns or units than the plan")
    rows = [sum(statuses.values()) for statuses in seal["statuses"]]
    if seal["first"] != begin or rows != [count for _, count in batches]:
        raise BadPart(f"does not hold exactly the samples {_span(plan, begin, sum(batches[-1]))}")
    span = (first, last) if merged else None
    return [
        Part(first + position, count, statuses, len(content), digest, span)
        for position, (count, statuses) in enumerate(zip(rows, seal["statuses"], strict=True))
    ]


def decode(plan: PlanHeader, content: bytes, rows: int, columns: Sequence[str] | None = None) -> "pa.Table":
    """Return ``rows`` rows of a checked file, with the columns in the given order, or all; BadPart if unreadable."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    names = plan.schema.names if columns is None else list(columns)
    schema = pa.schema([plan.schema.field(name) for name in names], plan.schema.metadata)
    try:
        footer = pq.read_metadata(pa.BufferReader(content))
        _check_size(footer, rows)
        file = pq.ParquetFile(pa.BufferReader(content), metadata=footer, read_dictionary=list(FEW_STRINGS))
        table = _plain(file.read(columns, use_threads=False))
        table = table if columns is None else table.select(names)
    except (pa.ArrowException, OSError, KeyError, ValueError, OverflowError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise BadPart(f"is not a Parquet file that this version can read ({reason})") from error
    table = table.replace_schema_metadata(plan.schema.metadata)
    if not table.schema.equals(schema, check_metadata=True):
        raise BadPart("has other columns or units than the plan")
    return table


def _check_size(footer: "pq.FileMetaData", rows: int) -> None:
    """Raise ValueError unless a file states the expected number of rows, and takes no more memory than rows may."""
    # It states what whoever sealed it has written: who can write to a store is trusted so far; see docs/security.md.
    if footer.num_rows != rows:
        raise ValueError(f"its footer says {footer.num_rows} rows in place of {rows}")
    size = sum(footer.row_group(group).total_byte_size for group in range(footer.num_row_groups))
    if size > LARGEST_DECODED:
        raise ValueError(f"it decodes to more than a file of {rows} rows may ({LARGEST_DECODED >> 20} MB)")


def _plain(table: "pa.Table") -> "pa.Table":
    """Return a table with its dictionary columns as plain strings; ValueError if that takes too much memory."""
    import pyarrow as pa
    import pyarrow.compute as pc

    size = 0
    for position, column in enumerate(table.schema):
        if pa.types.is_dictionary(column.type):
            for chunk in table[position].chunks:
                lengths = pc.binary_length(chunk.dictionary).cast(pa.int64()).take(chunk.indices)
                size += pc.sum(lengths).as_py() or 0
            # each value of a dictionary is decoded as often as the rows refer to it, which the pages do not tell
            if size > LARGEST_DECODED:
                raise ValueError(f"it decodes to more than {LARGEST_DECODED >> 20} MB")
            plain = pa.field(column.name, column.type.value_type, column.nullable, column.metadata)
            table = table.set_column(position, plain, table[position].cast(column.type.value_type))
    return table


def read_seal(content: bytes) -> tuple[str, dict[str, Any]]:
    """Return the digest of a file, with zeros in its own place, and the content of its seal; BadPart if incomplete."""
    start = content.rfind(_HEAD)
    digest_at = start + len(_HEAD)
    stated = content[digest_at : digest_at + len(_UNSEALED)]
    digest = hashlib.sha256(memoryview(content)[:digest_at])
    digest.update(_UNSEALED)
    digest.update(memoryview(content)[digest_at + len(_UNSEALED) :])
    if start < 0 or digest.hexdigest().encode() != stated:
        raise BadPart(
            f"is truncated or damaged ({len(content)} bytes, {'without a seal' if start < 0 else 'seal broken'})"
        )
    try:
        seal, _ = json.JSONDecoder().raw_decode(content[start:].decode("latin-1"))
        counts = [count for statuses in seal["statuses"] for count in statuses.values()]
        if not all(isinstance(count, int) and count > 0 for count in counts):
            raise ValueError("a number of rows is not a number")
        return stated.decode(), {key: seal[key] for key in ("campaign", "columns", "first", "statuses")}
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise BadPart("has a seal that clearcap did not write") from error


def _statuses(plan: PlanHeader, table: "pa.Table", first: int, last: int) -> list[dict[str, int]]:
    """Return the number of rows by status for each batch; ValueError if the rows are not those of the batches."""
    begin, end = plan.batches[first][0], sum(plan.batches[last])
    if table["sample"].to_pylist() != plan.numbers_of(begin, end):
        raise ValueError(f"the rows are not those of samples {_span(plan, begin, end)}")
    statuses = table["status"].to_pylist()
    spans = (plan.batches[batch] for batch in range(first, last + 1))
    return [dict(sorted(Counter(statuses[at - begin : at - begin + count]).items())) for at, count in spans]


def _span(plan: PlanHeader, begin: int, end: int) -> str:
    """Return the first and the last sample of the rows ``begin`` to ``end - 1``, in words."""
    numbers = plan.numbers_of(begin, end)
    return f"{numbers[0]} to {numbers[-1]}"


def total(counts: Iterable[Mapping[str, int]]) -> dict[str, int]:
    """Return the sum of counts by status, sorted."""
    summed: Counter[str] = Counter()
    for each in counts:
        summed.update(each)
    return dict(sorted(summed.items()))


# -- the manifest ------------------------------------------------------------------------------------------------------
#
# ``manifest.json`` lists the parts as last checked, so that they need not be read again. It only saves time: a file
# that it does not list, or lists with another size, is read.


def dump_manifest(plan: PlanHeader, parts: Iterable[Part]) -> bytes:
    """Return the content of a manifest."""
    files: dict[str, Any] = {}
    for part in sorted(parts, key=lambda part: part.batch):
        entry = files.setdefault(part.file, {"size": part.size, "sha256": part.sha256, "statuses": {}})
        entry["statuses"][str(part.batch)] = part.statuses
    document = {"format": MANIFEST_FORMAT, "campaign": plan.sealed_as, "digest": _digest(files), "files": files}
    return (json.dumps(document, separators=(",", ":")) + "\n").encode()


def parse_manifest(plan: PlanHeader, content: bytes) -> dict[str, list[Part]]:
    """Return the parts that a manifest names, by file; ValueError if it is not this plan's, or was changed."""
    document = json.loads(content)
    try:
        if (document["format"], document["campaign"]) != (MANIFEST_FORMAT, plan.sealed_as):
            raise ValueError("it belongs to another campaign or has another format")
        if document["digest"] != _digest(document["files"]):
            raise ValueError("its content was changed after it was written")
        files = {name: _listed_parts(plan, name, entry) for name, entry in document["files"].items()}
        return {name: parts for name, parts in files.items() if parts}
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"its content is not that of a manifest ({error!r})") from error


def _listed_parts(plan: PlanHeader, name: str, entry: dict[str, Any]) -> list[Part]:
    """Return the parts in a file, as its entry lists them; empty if the entry does not list all of them."""
    span = batches_of(name, plan)
    size, sha256 = int(entry["size"]), str(entry["sha256"])
    if span is None or size <= 0 or not re.fullmatch("[0-9a-f]{64}", sha256):
        raise ValueError(f"it lists a file that cannot be a file of rows: {name[:60]!r}")
    merged = span if name.startswith("rows") else None
    parts = []
    for key, statuses in entry["statuses"].items():
        batch, rows = int(key), sum(statuses.values())
        if not span[0] <= batch <= span[1] or rows != plan.batches[batch][1]:
            raise ValueError(f"its number of rows of batch {batch} differs from the plan")
        parts.append(Part(batch, rows, statuses, size, sha256, merged))
    return parts if len(parts) == span[1] - span[0] + 1 else []


def _digest(files: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(files, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


# -- the survey --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Survey:
    """The parts and rows of a plan that a store holds."""

    parts: dict[int, Part]  # sound ones, by batch
    missing: list[int]  # batches whose rows the table still lacks; none beyond its end
    bad: dict[int, str]  # what is wrong with bad files, by batch; it is missing unless another file holds it too
    statuses: dict[str, int]  # number of rows of the table by status
    rows: int  # of the table


@dataclass
class PartIndex:
    """The sound parts of a plan and its bad files, collected during a survey."""

    parts: dict[int, Part] = field(default_factory=dict)  # to read each batch from
    bad: dict[int, str] = field(default_factory=dict)  # what is wrong with the bad files, by batch

    def add(self, parts: Iterable[Part]) -> None:
        """Add the parts of a file; of two parts of a batch, the one that `rank` puts first is kept."""
        for part in parts:
            other = self.parts.get(part.batch)
            if other is None or rank(part) < rank(other):
                self.parts[part.batch] = part


def rank(part: Part) -> tuple[int, int]:
    """Return a sort key for the files that hold a batch: its own file first, then longer merged files first."""
    # a rerun writes a part beside the merged file, so the part is the newer one
    return (0, 0) if part.merged is None else (1, part.merged[0] - part.merged[1])


def survey(files: Files, plan: PlanHeader, end: int, *, verify: bool) -> Survey:
    """Return which parts and rows of a plan a store holds; rows from ``end`` on do not count. See `Store.survey`."""
    index = _index_parts(files, plan, verify=verify)
    parts = dict(sorted(index.parts.items()))
    needed = range(plan.batches_before(end))
    statuses = total(_count_statuses(files, plan, parts[batch], end) for batch in needed if batch in parts)
    missing = [batch for batch in needed if batch not in parts]
    return Survey(parts, missing, dict(sorted(index.bad.items())), statuses, sum(statuses.values()))


def load_manifest(files: Files, plan: PlanHeader) -> dict[str, list[Part]]:
    """Return the parts that the manifest lists, by file; empty, with a warning, if it cannot be used."""
    name = manifest_name(plan)
    try:
        return parse_manifest(plan, files.read(name))
    except FileNotFoundError:
        return {}
    except (ValueError, StoreError, RecursionError) as error:  # RecursionError: JSON nested too deeply
        logger.warning("%s is not valid, so all parts are read instead: %s", name, error)
        return {}


class Reader(Protocol):
    """What reads the files of a store by their names, `Files` or others."""

    def read(self, name: str) -> bytes:
        """Return a file's content; see `Files.read`."""


def check_file(files: Reader, plan: PlanHeader, name: str) -> list[Part]:
    """Return the parts in a file of rows of this plan; FileNotFoundError or BadPart if it is none."""
    return _read_checked(files, plan, name)[1]


def read_file(files: Reader, plan: PlanHeader, name: str, columns: Sequence[str] | None = None) -> "pa.Table":
    """Return the rows of a file, with all columns or the named ones; raises the same errors as `check_file`."""
    content, parts = _read_checked(files, plan, name)
    return decode(plan, content, sum(part.rows for part in parts), columns)


def read_part_file(files: Reader, plan: PlanHeader, batch: int) -> "tuple[Part, pa.Table]":
    """Return a batch's own part and its rows, from one read; raises the same errors as `check_file`."""
    content, (part,) = _read_checked(files, plan, file_name(batch, batch))
    return part, decode(plan, content, part.rows)


def _read_checked(files: Reader, plan: PlanHeader, name: str) -> tuple[bytes, list[Part]]:
    span = batches_of(name, plan)
    if span is None:
        raise file_gone(name)
    content = _read_content(files, plan, name)
    return content, check(plan, content, *span, merged=name.startswith("rows"))


def _read_content(files: Reader, plan: PlanHeader, name: str) -> bytes:
    """Return the content of a file of rows; BadPart if it is not a regular file, or too large."""
    try:
        return files.read(f"{folder(plan)}/{name}")
    except OddFile as error:
        raise BadPart(error.reason) from error


def _index_parts(files: Files, plan: PlanHeader, *, verify: bool) -> PartIndex:
    """Return the sound and the bad files in a plan's folder of parts."""
    # If parts are merged while the folder is being listed, the listing may miss both the part and the merged file. So
    # if a batch is missing, the folder is listed a second time.
    recorded, index = load_manifest(files, plan), PartIndex()
    done: set[str] = set()
    for _ in range(2):
        sizes = files.sizes(folder(plan))
        if files.local:  # the listing of a shared folder may lag behind its files
            sizes |= _sizes_of_unlisted(files, plan, recorded.keys() - sizes.keys())
        to_read = []
        for name in sorted(sizes.keys() - done):
            # a listing has the size, but the hash takes reading the file: only ``verify`` finds damage that keeps it
            known = recorded.get(name) if batches_of(name, plan) else None
            if not verify and known and known[0].size == sizes[name]:
                index.add(known)
            else:
                to_read.append(name)
        _check_files(files, plan, to_read, index)
        done |= sizes.keys()
        if len(index.parts) == len(plan.batches):
            break
    return index


def _sizes_of_unlisted(files: Files, plan: PlanHeader, names: Iterable[str]) -> dict[str, int]:
    """Return the sizes of the files that exist although the listing lacks them."""
    sizes = {}
    for name in names:
        try:
            sizes[name] = files.size(f"{folder(plan)}/{name}")
        except FileNotFoundError:
            continue
    return sizes


def _check_files(files: Files, plan: PlanHeader, names: list[str], index: PartIndex) -> None:
    """Read files, several at a time because an object store answers slowly, and add them to the index."""

    # If the store fails, only this thread waits for it, so that Ctrl-C ends the waiting.
    def check_one(files: Files, name: str) -> list[Part] | str:
        try:
            return check_file(files, plan, name)
        except FileNotFoundError:  # merged or quarantined since the listing
            return []
        except BadPart as error:
            return f"{name} {error}"

    def try_one(name: str) -> list[Part] | str | None:
        try:
            return check_one(files.hasty, name)
        except StoreError:
            return None

    files_of_rows = [name for name in names if batches_of(name, plan)]
    with ThreadPoolExecutor(READERS) as pool:
        for name, tried in zip(files_of_rows, pool.map(try_one, files_of_rows), strict=True):
            # a pool cannot be left before its threads end, so they try once and the waiting is done here
            result = check_one(files, name) if tried is None else tried
            if isinstance(result, str):
                first, last = batches_of(name, plan) or (0, -1)
                index.bad.update(dict.fromkeys(range(first, last + 1), result))
            else:
                index.add(result)


def _count_statuses(files: Files, plan: PlanHeader, part: Part, end: int) -> dict[str, int]:
    """Return the number of rows of a part before row ``end``, by status."""
    first, count = plan.batches[part.batch]
    if first + count <= end:
        return part.statuses
    # the table ends within this batch, where the stopping rule ended the campaign, and a seal counts whole batches
    table = read_file(files, plan, part.file, ["status"])
    begin = plan.batches[part.merged[0] if part.merged else part.batch][0]
    statuses = table["status"].slice(first - begin, end - first).to_pylist()
    return {status: statuses.count(status) for status in set(statuses)}
