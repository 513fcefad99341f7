"""What a footer says is read as pyarrow reads it; one that is not sound is an error, never the end of the process."""

import io

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from campaign.footers import column_chunks as subject
from campaign.footers.column_chunks import column_chunks, pages

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
