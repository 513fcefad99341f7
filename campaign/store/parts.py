"""Files of rows: their names, their content, and the seal that tells a sound one from any other.

Each is a Parquet file with a seal among its metadata: whose rows it holds, which, in what columns, how they ended, and
a SHA-256 over the whole file. So a file says by itself whether it is whole, wherever damage may have hit it, and
counting rows does not take reading them. A merged file holds the rows of several batches and is otherwise the same.
"""

import hashlib
import io
import json
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from campaign.plan_header import PlanHeader
from campaign.store.layout import PARTS

if TYPE_CHECKING:
    import pyarrow as pa

ROW_GROUP = 10_000  # rows: what a reader of a merged file must hold at least
FEW_STRINGS = ("status", "message", "earlier_attempts")  # columns with few distinct values, written once each
SEAL = "clearcap.seal"  # key of the metadata
_HEAD = b'{"clearcap":1,"sha256":"'
_UNSEALED = b"0" * 64  # in place of the digest, while it is taken
_PART = re.compile(r"part-(\d{6,9})\.parquet")
_MERGED = re.compile(r"rows-(\d{6,9})-(\d{6,9})\.parquet")


class BadPart(Exception):
    """A file of rows that is not what its name says; the message says why."""


@dataclass(frozen=True)
class Part:
    """The rows of one batch, as they are in the store.

    Attributes
    ----------
    batch : int
        Which.
    rows : int
        How many.
    statuses : dict of str to int
        How many ended in which status.
    size : int
        Of the file that holds them [bytes].
    sha256 : str
        Digest in that file's seal.
    merged : tuple of (int, int) or None
        First and last batch of the merged file that holds them; None if they have a file of their own.
    """

    batch: int
    rows: int
    statuses: dict[str, int]
    size: int
    sha256: str
    merged: tuple[int, int] | None = None

    @property
    def file(self) -> str:
        """Name of the file, within the folder of the parts."""
        return file_name(*(self.merged or (self.batch, self.batch)), merged=self.merged is not None)


def folder(plan: PlanHeader) -> str:
    """Return the folder of a campaign's parts, relative to the store."""
    return f"{plan.campaign_id}/{PARTS}"


def part_name(plan: PlanHeader, batch: int) -> str:
    """Return the name of a batch's own part, relative to the store."""
    return f"{folder(plan)}/{file_name(batch, batch)}"


def file_name(first: int, last: int, *, merged: bool = False) -> str:
    """Return the name of the file of some batches within the folder of the parts."""
    return f"rows-{first:06d}-{last:06d}.parquet" if merged else f"part-{first:06d}.parquet"


def batches_of(name: str, plan: PlanHeader) -> tuple[int, int] | None:
    """Return first and last batch that a file of this name holds; None if it is no file of rows of this plan."""
    if match := _PART.fullmatch(name):
        first = last = int(match[1])
    elif match := _MERGED.fullmatch(name):
        first, last = int(match[1]), int(match[2])
    else:
        return None
    sound = first <= last < len(plan.batches) and name == file_name(first, last, merged=name.startswith("rows"))
    return (first, last) if sound else None


def encode(plan: PlanHeader, table: "pa.Table", first: int, last: int) -> bytes:
    """Return the rows of batches ``first`` to ``last``, in the plan's columns, as the content of their file."""
    import pyarrow.parquet as pq

    rows = table if table.schema.equals(plan.schema, check_metadata=True) else table.cast(plan.schema)
    buffer = io.BytesIO()
    seal = {
        "campaign": plan.campaign_id,
        "columns": plan.columns,
        "first": plan.batches[first][0],
        "statuses": _statuses(plan, rows, first, last),
    }
    codec = "lz4" if first == last else "zstd"  # a batch's few rows get no smaller by zstd, and it takes thrice as long
    writer = pq.ParquetWriter(
        buffer, plan.schema, compression=codec, use_dictionary=list(FEW_STRINGS), write_statistics=False
    )
    with writer:
        writer.write_table(rows, row_group_size=ROW_GROUP)
        writer.add_key_value_metadata({SEAL: (_HEAD + _UNSEALED).decode() + '",' + json.dumps(seal)[1:]})
    content = buffer.getbuffer()
    place = bytes(content).rindex(_HEAD) + len(_HEAD)
    content[place : place + len(_UNSEALED)] = hashlib.sha256(content).hexdigest().encode()
    return bytes(content)


def check(plan: PlanHeader, content: bytes, first: int, last: int, *, merged: bool) -> list[Part]:
    """Return what is to be known of batches ``first`` to ``last`` from the content of their file.

    Raises
    ------
    BadPart
        If it is truncated, damaged, or from elsewhere.
    """
    digest, seal = _seal(content)
    begin, batches = plan.batches[first][0], plan.batches[first : last + 1]
    if seal["campaign"] != plan.campaign_id:
        raise BadPart(f"belongs to campaign {seal['campaign']}")
    if seal["columns"] != plan.columns:
        raise BadPart("has other columns or units than the plan")
    rows = [sum(statuses.values()) for statuses in seal["statuses"]]
    if seal["first"] != begin or rows != [count for _, count in batches]:
        raise BadPart(f"does not hold exactly the samples {begin} to {sum(batches[-1]) - 1}")
    span = (first, last) if merged else None
    return [
        Part(first + position, count, statuses, len(content), digest, span)
        for position, (count, statuses) in enumerate(zip(rows, seal["statuses"], strict=True))
    ]


def decode(plan: PlanHeader, content: bytes, columns: Sequence[str] | None = None) -> "pa.Table":
    """Return the rows of a file that has been checked; BadPart if there are none that this version can read.

    Only the ``columns`` named are read, in that order; all of them by default.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    names = plan.schema.names if columns is None else list(columns)
    wanted = pa.schema([plan.schema.field(name) for name in names], plan.schema.metadata)
    try:
        table = pq.ParquetFile(pa.BufferReader(content)).read(columns, use_threads=False)
        table = table if columns is None else table.select(names)
    except (pa.ArrowException, OSError, KeyError) as error:
        raise BadPart(f"no Parquet file that can be read here ({str(error).splitlines()[0]})") from error
    table = table.replace_schema_metadata(plan.schema.metadata)
    if not table.schema.equals(wanted, check_metadata=True):
        raise BadPart("has other columns or units than the plan")
    return table


def _seal(content: bytes) -> tuple[str, dict[str, Any]]:
    """Return the digest of a file and what it says of itself, if it is whole.

    The digest is over the file with zeros in its own place.
    """
    start = content.rfind(_HEAD)
    place = start + len(_HEAD)
    stated = content[place : place + len(_UNSEALED)]
    digest = hashlib.sha256(memoryview(content)[:place])
    digest.update(_UNSEALED)
    digest.update(memoryview(content)[place + len(_UNSEALED) :])
    if start < 0 or digest.hexdigest().encode() != stated:
        raise BadPart(f"is not whole ({len(content)} bytes, {'without a seal' if start < 0 else 'seal broken'})")
    seal, _ = json.JSONDecoder().raw_decode(content[start:].decode("latin-1"))
    return stated.decode(), seal


def _statuses(plan: PlanHeader, table: "pa.Table", first: int, last: int) -> list[dict[str, int]]:
    """Return how many rows of each batch ended in which status; ValueError if they are not the batches' rows."""
    begin, end = plan.batches[first][0], sum(plan.batches[last])
    if table["sample"].to_pylist() != list(range(begin, end)):
        raise ValueError(f"not the rows of samples {begin} to {end - 1}")
    statuses = table["status"].to_pylist()
    spans = (plan.batches[batch] for batch in range(first, last + 1))
    return [dict(sorted(Counter(statuses[at - begin : at - begin + count]).items())) for at, count in spans]


def total(counts: Iterable[Mapping[str, int]]) -> dict[str, int]:
    """Return the sum of counts by status, sorted."""
    summed: Counter[str] = Counter()
    for each in counts:
        summed.update(each)
    return dict(sorted(summed.items()))
