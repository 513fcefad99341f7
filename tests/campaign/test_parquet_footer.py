"""A footer is read as pyarrow and the specification read it; one that is not sound is an error, never a crash."""

import io

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from campaign import parquet_footer as subject
from campaign.parquet_footer import column_chunks, pages, read_struct
from tests.each import each

TABLE = pa.table(
    {
        "x": np.linspace(0.0, 1.0, 50),
        "words": [f"a{i}" for i in range(50)],
        "nested": [{"low": i, "high": [i, i + 1]} for i in range(50)],
        "empty": pa.nulls(50),
    }
)
WAYS = [
    {},
    {"data_page_version": "2.0", "row_group_size": 20},
    {"use_dictionary": False, "compression": None},
    {"compression": "zstd", "write_statistics": False, "data_page_size": 64},
    {"write_page_index": True, "write_page_checksum": True, "store_schema": False},
]


def written(**how):
    """Return the table as a Parquet file, and what pyarrow says of it."""
    buffer = io.BytesIO()
    pq.write_table(TABLE, buffer, **how)
    return buffer.getvalue(), pq.ParquetFile(buffer).metadata


@pytest.mark.parametrize("how", WAYS)
def test_chunks_are_those_that_pyarrow_finds(how):
    """Names, sizes and places; the pages' own headers add up to what an honest footer says."""
    content, footer = written(**how)
    groups = [footer.row_group(number) for number in range(footer.num_row_groups)]
    expected = [(group.column(i), group.num_rows) for group in groups for i in range(group.num_columns)]
    for chunk, (column, rows) in zip(column_chunks(content), expected, strict=True):
        assert (chunk.path, chunk.rows) == (column.path_in_schema, rows)
        assert (chunk.values, chunk.uncompressed) == (column.num_values, column.total_uncompressed_size)
        assert chunk.end - chunk.begin == column.total_compressed_size
        starts = [column.dictionary_page_offset, column.data_page_offset]
        assert chunk.begin == min(at for at in starts if at)
        sizes = list(pages(content, chunk))
        assert sum(values for _, values in sizes) >= chunk.values
        assert 0 < sum(size for size, _ in sizes) <= chunk.uncompressed


def test_unsound_footers_are_errors(monkeypatch):
    """Cut, too long, or of something else: a ValueError."""
    content, _ = written()
    size = int.from_bytes(content[-8:-4], "little")
    for unsound in (b"", b"PAR1", content[:-9], bytes(size) + content[-8:], b"\xff" * size + content[-8:]):
        with pytest.raises(ValueError, match=r"header|footer"):
            list(column_chunks(unsound))
    monkeypatch.setattr(subject, "LARGEST_FOOTER", 100)
    with pytest.raises(ValueError, match=f"its footer has {size} bytes; allowed: at most 100"):
        list(column_chunks(content))


@each(
    ("content", "fields"),
    [
        (b"\x00", {}),
        (b"\x15\x06\x00", {1: 3}),  # field 1, an i32: zigzag of 3
        (b"\x25\x05\x16\xac\x02\x00", {2: -3, 3: 150}),
        (b"\x05\x28\x02\x00", {20: 1}),  # a field number of its own
        (b"\x11\x12\x00", {1: None, 2: None}),  # true, false
        (b"\x18\x02ab\x00", {1: b"ab"}),
        (b"\x17" + bytes(8) + b"\x15\x02\x00", {1: None, 2: 1}),  # a double is passed over
        (b"\x1c\x15\x02\x00\x00", {1: {1: 1}}),
        (b"\x19\x25\x02\x04\x00", {1: [1, 2]}),
        (b"\x19\x21\x01\x02\x15\x02\x00", {1: [None, None], 2: 1}),  # Booleans of a list are bytes
        (b"\x19\xf5\x10" + b"\x02" * 16 + b"\x00", {1: [1] * 16}),
    ],
)
def test_structs(content, fields):
    """Each kind of value, and where the struct ends."""
    assert read_struct(content, 0) == (fields, len(content))
    assert read_struct(b"--" + content + b"--", 2) == (fields, len(content) + 2)


@pytest.mark.parametrize(
    "content", [b"", b"\x15", b"\x1d\x00", b"\x15" + b"\xff" * 11, b"\x1c" * 100, b"\x19\x19" * 50]
)
def test_unsound_structs(content):
    """Cut off, of an unknown kind, a number without end, nested without end."""
    with pytest.raises(ValueError, match="header"):
        read_struct(content, 0)


def test_length_that_lies_takes_no_memory():
    """A list that says it has a billion billion elements."""
    with pytest.raises(ValueError, match="outside of the file"):
        read_struct(b"\x19\xf1" + b"\xff" * 8 + b"\x7f" + b"\x00" * 100, 0)


@given(st.binary(max_size=200))
def test_any_bytes(content):
    """Fields or a ValueError, and no place beyond what is there but by the last value."""
    try:
        fields, _ = read_struct(content, 0)
    except ValueError:
        return
    assert all(isinstance(field, int) for field in fields)
