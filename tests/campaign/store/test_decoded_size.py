"""Parts that would take more memory than rows can are refused before they are decoded."""

import hashlib
import io

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from campaign.store import BadPart, parts
from campaign.store.parts import check, decode, encode
from tests.campaign.store.test_store import fill


@pytest.fixture
def part(store, plan):
    """Return the table and the content of a sound part of ten rows."""
    fill(store, plan, [1])
    table = store.read_part(plan, 1)
    return table, encode(plan, table, 1, 1)


def written(table, **how):
    """Return a table as a Parquet file."""
    buffer = io.BytesIO()
    pq.write_table(table, buffer, **how)
    return buffer.getvalue()


def test_millions_of_equal_rows_are_refused(plan):
    """A file of a few kilobytes, sealed or not, with more rows than its batch."""
    rows = pa.table({"sample": pa.array([0], pa.int64()).take(pa.array([0] * 3_000_000))})
    content = written(rows, compression="zstd")
    assert len(content) < 50_000
    with pytest.raises(BadPart, match=r"3000000 rows.*\b10\b"):
        decode(plan, content, 10)


def test_decoded_size_is_bounded(plan, part, monkeypatch):
    """Pages that expand, and few strings that are repeated, count with what they take in memory."""
    table, _ = part
    position = table.schema.get_field_index("message")
    long = table.set_column(position, table.schema.field(position), pa.array(["x" * 300_000] * 10))
    content = encode(plan, long, 1, 1)
    assert len(content) < 100_000
    assert decode(plan, content, 10).equals(long)
    monkeypatch.setattr(parts, "LARGEST_DECODED", 2**20)
    with pytest.raises(BadPart, match="decodes to more than"):
        decode(plan, content, 10)
    monkeypatch.setattr(parts, "LARGEST_DECODED", 2**10)
    with pytest.raises(BadPart, match=r"a file of 10 rows may"):
        decode(plan, content, 10)


@pytest.mark.parametrize(
    "forged",
    [
        b'"statuses": [{"ok": -9}]',
        b'"statuses": [{"ok":"a"}]',
        b'"statusez": [{"ok": 10}]',
        b'"statuses": [["ok", 10]]',
    ],
)
def test_forged_seal_is_a_bad_part(plan, part, forged):
    """Whoever knows how a seal is made may seal nonsense: it is a damaged part all the same."""
    _, content = part
    sound = b'"statuses": [{"ok": 10}]'
    assert sound in content
    assert len(forged) in (len(sound), len(sound) - 1)
    content = content.replace(sound, forged.ljust(len(sound)))
    at = content.rindex(b'"sha256":"') + 10
    blank = content[:at] + b"0" * 64 + content[at + 64 :]
    content = blank[:at] + hashlib.sha256(blank).hexdigest().encode() + blank[at + 64 :]
    with pytest.raises(BadPart):
        check(plan, content, 1, 1, merged=False)
