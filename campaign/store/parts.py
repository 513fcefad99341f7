"""Parts, the files of rows: their names, their content, and the seal that shows that a file is sound.

Each part is a Parquet file with a seal in its metadata: campaign, samples, columns, statuses, and a SHA-256 over the
whole file. So every file proves by itself that it is complete, and rows are counted without reading them. A merged file
holds the rows of several batches and is otherwise the same.
"""

import hashlib
import io
import json
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from campaign.errors import file_gone
from campaign.plan_header import PlanHeader
from campaign.store.files.files import OddFile

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


# -- files of rows ----------------------------------------------------------------------------------------------------


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
