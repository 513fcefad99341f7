"""How much memory a Parquet file takes once it is decoded, known before anything is.

A file of some kilobytes may decode to gigabytes, and its footer may say otherwise. So the headers of its pages, which
are what a reader goes by, are read here; they are structs of the Thrift compact protocol (Apache Parquet format,
``PageHeader``).
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pyarrow.parquet as pq

MOST = 2**30  # bytes: thirty times what the largest merged file takes
DEEPEST = 8  # nested structs of a page header; it has two
_TYPE, _UNCOMPRESSED, _COMPRESSED = 1, 2, 3  # fields of a page header
_HEADS = (5, 7, 8)  # of them, the heads of a data page, a dictionary, a data page of version 2
_VALUES = 1  # field of such a head


def check_decoded_size(content: bytes, footer: "pq.FileMetaData", rows: int) -> None:
    """Check that a Parquet file holds this number of rows in every column, and no more memory than a file of rows may.

    Parameters
    ----------
    content : bytes
        Of the file.
    footer : pyarrow.parquet.FileMetaData
        What its footer says.
    rows : int
        Number of rows that it must have.

    Raises
    ------
    ValueError
        If it does not, or its footer or a page header is not sound; the message says what is wrong.
    """
    size = 0
    if footer.num_rows != rows:
        raise ValueError(f"its footer says {footer.num_rows} rows in place of {rows}")
    for number in range(footer.num_row_groups):
        group = footer.row_group(number)
        for position in range(group.num_columns):
            column = group.column(position)
            begin = min(at for at in (column.dictionary_page_offset, column.data_page_offset) if at)
            for uncompressed, values in _pages(content, begin, begin + column.total_compressed_size):
                size += uncompressed
                if values > rows or size > MOST:
                    raise ValueError(f"it decodes to more than a file of {rows} rows may ({MOST >> 20} MB)")
            if column.num_values != group.num_rows or group.num_rows > rows:
                raise ValueError("its columns have different numbers of rows")


def _pages(content: bytes, at: int, end: int) -> Iterator[tuple[int, int]]:
    """Yield the decoded size and the number of values of each page of a column."""
    while at < end:
        header, at = _struct(content, at)
        heads = [header[field] for field in _HEADS if isinstance(header.get(field), dict)]
        head = heads[0] if heads else {}
        sizes = [header.get(_UNCOMPRESSED), header.get(_COMPRESSED), head.get(_VALUES, 0)]
        uncompressed, compressed, values = (size if isinstance(size, int) else -1 for size in sizes)
        if _TYPE not in header or min(uncompressed, compressed, values) < 0:
            raise ValueError("a page has no sound header")
        yield uncompressed, values
        at += compressed


def _struct(content: bytes, at: int, depth: int = 0) -> tuple[dict[int, Any], int]:
    """Return the numbers and structs among the fields of a struct, and where it ends."""
    if depth > DEEPEST:
        raise ValueError("a page header is nested too deeply")
    fields: dict[int, Any] = {}
    field = 0
    while True:
        head, at = _byte(content, at)
        if head == 0:
            return fields, at
        kind = head & 15
        if head >> 4:
            field += head >> 4
        else:
            field, at = _number(content, at)
        fields[field], at = _value(content, at, kind, depth)


def _value(content: bytes, at: int, kind: int, depth: int) -> tuple[Any, int]:
    """Return a value and where it ends; None for one that a page header's sizes do without."""
    if kind in (1, 2):  # true, false
        return None, at
    if kind == 3:
        return None, at + 1
    if kind in (4, 5, 6):
        return _number(content, at)
    if kind == 7:
        return None, at + 8
    if kind == 8:
        length, at = _varint(content, at)
        return None, at + length
    if kind == 12:
        return _struct(content, at, depth + 1)
    raise ValueError("a page header has a field that none has")


def _byte(content: bytes, at: int) -> tuple[int, int]:
    """Return the byte at a place, and the next place."""
    if not 0 <= at < len(content):
        raise ValueError("a page lies outside of the file")
    return content[at], at + 1


def _varint(content: bytes, at: int) -> tuple[int, int]:
    """Return a number of seven bits a byte, and where it ends."""
    value = 0
    for shift in range(0, 70, 7):
        byte, at = _byte(content, at)
        value |= (byte & 127) << shift
        if byte < 128:
            return value, at
    raise ValueError("a page header has a number of too many digits")


def _number(content: bytes, at: int) -> tuple[int, int]:
    """Return a number whose sign is its last bit, and where it ends."""
    value, at = _varint(content, at)
    return (value >> 1) ^ -(value & 1), at
