"""The column chunks listed in the footer of a Parquet file (Apache Parquet format, ``FileMetaData``), and their pages.

They are read here because pyarrow crashes the process if a damaged footer contradicts itself about a column.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from campaign.footers.thrift_structs import read_struct

LARGEST_FOOTER = 4_000_000  # bytes; a footer of a thousand columns in a dozen groups has a million
_TAIL = 8  # bytes: length of the footer, and PAR1
_GROUPS, _COLUMNS, _ROWS, _META = 4, 1, 3, 3  # fields: of the file, of a group (two), of a column
_PATH, _VALUES, _UNCOMPRESSED, _COMPRESSED, _DATA, _DICTIONARY = 3, 5, 6, 7, 9, 11  # fields of a column's metadata
_PAGE_TYPE, _PAGE_UNCOMPRESSED, _PAGE_COMPRESSED = 1, 2, 3  # fields of a page header
_PAGE_HEADS = (5, 7, 8)  # fields of a page header: heads of a data page, a dictionary, a data page of version 2
_PAGE_VALUES = 1  # field of such a head


@dataclass(frozen=True)
class ColumnChunk:
    """A column of one row group, as the footer describes it."""

    path: str  # name of the column, preceded by the names of its parents if it is nested
    rows: int  # of the group
    values: int  # of the column in the group
    uncompressed: int  # size of its pages once decompressed [bytes]
    begin: int  # offset of its pages in the file
    end: int


def column_chunks(content: bytes) -> Iterator[ColumnChunk]:
    """Yield the column chunks of a Parquet file, group by group.

    Raises ValueError if its footer is malformed or too long.
    """
    length = int.from_bytes(content[-_TAIL : -_TAIL // 2], "little")
    if length > min(LARGEST_FOOTER, len(content) - _TAIL):
        raise ValueError(f"its footer has {length} bytes; allowed: at most {LARGEST_FOOTER}, and no more than the file")
    footer, _ = read_struct(content[len(content) - _TAIL - length : len(content) - _TAIL], 0)
    for group in _structs(footer, _GROUPS):
        for column in _structs(group, _COLUMNS):
            yield _chunk(column.get(_META), group.get(_ROWS))


def _structs(struct: dict[int, Any], field: int) -> list[dict[int, Any]]:
    """Return the list of structs in a field of a struct."""
    found = struct.get(field)
    if not isinstance(found, list) or not all(isinstance(element, dict) for element in found):
        raise ValueError("its footer lacks row groups or columns")
    return found


def _chunk(column: Any, rows: Any) -> ColumnChunk:
    """Return the column chunk that a column's metadata describes."""
    if not isinstance(column, dict):
        raise ValueError("its footer lacks the metadata of a column")
    path, dictionary = column.get(_PATH), column.get(_DICTIONARY)
    sizes = [rows, *(column.get(field) for field in (_VALUES, _UNCOMPRESSED, _COMPRESSED, _DATA))]
    if not all(isinstance(size, int) and size >= 0 for size in sizes) or not isinstance(path, list):
        raise ValueError("its footer lacks the size or the place of a column")
    names = [name.decode("utf-8", "replace") if isinstance(name, bytes) else "" for name in path]
    # the page of its dictionary, if there is one, comes before those of its values; an offset of 0 stands for none
    begin = min(at for at in (dictionary, sizes[-1]) if isinstance(at, int) and at > 0) if sizes[-1] else 0
    return ColumnChunk(".".join(names), rows, sizes[1], sizes[2], begin, begin + sizes[3])


def pages(content: bytes, chunk: ColumnChunk) -> Iterator[tuple[int, int]]:
    """Yield the decoded size [bytes] and the number of values that each page header of a column chunk states.

    Raises ValueError if a page has a malformed header.
    """
    at = chunk.begin
    while at < chunk.end:
        header, at = read_struct(content, at)
        heads = [header[field] for field in _PAGE_HEADS if isinstance(header.get(field), dict)]
        head = heads[0] if heads else {}
        sizes = [header.get(_PAGE_UNCOMPRESSED), header.get(_PAGE_COMPRESSED), head.get(_PAGE_VALUES, 0)]
        uncompressed, compressed, values = (size if isinstance(size, int) else -1 for size in sizes)
        if _PAGE_TYPE not in header or min(uncompressed, compressed, values) < 0:
            raise ValueError("a page has no sound header")
        yield uncompressed, values
        at += compressed
