"""Read the footer of a Parquet file without decoding the data, so that a harmful file can be refused beforehand.

The footer (Apache Parquet format, ``FileMetaData``) lists the column chunks, and each chunk has pages with headers.
They are read here because pyarrow crashes the process if a damaged footer contradicts itself about a column. Nothing is
trusted: malformed content raises ValueError.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

LARGEST_FOOTER = 4_000_000  # bytes; a footer of a thousand columns in a dozen groups has a million
_TAIL = 8  # bytes: length of the footer, and PAR1
_GROUPS, _COLUMNS, _ROWS, _META = 4, 1, 3, 3  # fields: of the file, of a group (two), of a column
_PATH, _VALUES, _UNCOMPRESSED, _COMPRESSED, _DATA, _DICTIONARY = 3, 5, 6, 7, 9, 11  # fields of a column's metadata
_PAGE_TYPE, _PAGE_UNCOMPRESSED, _PAGE_COMPRESSED = 1, 2, 3  # fields of a page header
_PAGE_HEADS = (5, 7, 8)  # fields of a page header: heads of a data page, a dictionary, a data page of version 2
_PAGE_VALUES = 1  # field of such a head
DEEPEST = 12  # nested structs and lists; a footer has seven
_LONG = 15  # in the head of a list: the length follows


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


# -- the Thrift compact protocol ---------------------------------------------------------------------------------------
#
# Parquet writes its footer and its page headers as structs of this protocol. Every element takes at least one byte, so
# the time to read is proportional to the length of the content.


def read_struct(content: bytes, at: int, depth: int = 0) -> tuple[dict[int, Any], int]:
    """Return the fields by number of a struct that begins at an offset, and the offset of its end.

    Integers are int, texts bytes, structs dict, lists list; other values are None. ``depth`` is the number of structs
    and lists that enclose it. Raises ValueError if it is malformed.
    """
    if depth > DEEPEST:
        raise ValueError("a header is nested too deeply")
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
        if kind in (1, 2):  # true and false have no bytes of their own
            fields[field] = None
        else:
            fields[field], at = _value(content, at, kind, depth)


def _value(content: bytes, at: int, kind: int, depth: int) -> tuple[Any, int]:
    """Return a value of a kind, and the offset of its end."""
    # kinds of the compact protocol: 1 and 2 true and false, 3 a byte, 4 to 6 integers, 7 a double, 8 bytes, 9 a list,
    # 12 a struct
    if kind in (1, 2, 3):  # one byte; in a list a Boolean takes one byte, too
        return None, at + 1
    if kind in (4, 5, 6):
        return _number(content, at)
    if kind == 7:
        return None, at + 8
    if kind == 8:
        length, at = _varint(content, at)
        return content[at : at + length], at + length
    if kind == 9:
        return _list(content, at, depth + 1)
    if kind == 12:
        return read_struct(content, at, depth + 1)
    raise ValueError("a header has an unknown field")


def _list(content: bytes, at: int, depth: int) -> tuple[list[Any], int]:
    """Return the elements of a list, and the offset of its end."""
    if depth > DEEPEST:
        raise ValueError("a header is nested too deeply")
    head, at = _byte(content, at)
    length = head >> 4
    if length == _LONG:
        length, at = _varint(content, at)
    elements = []
    for _ in range(length):
        _byte(content, at)  # ValueError at the end of the content: the stated length may be false
        element, at = _value(content, at, head & 15, depth)
        elements.append(element)
    return elements, at


def _byte(content: bytes, at: int) -> tuple[int, int]:
    """Return the byte at an offset, and the next offset."""
    if not 0 <= at < len(content):
        raise ValueError("a header lies outside of the file")
    return content[at], at + 1


def _varint(content: bytes, at: int) -> tuple[int, int]:
    """Return a number stored with seven bits per byte, and the offset of its end."""
    value = 0
    for shift in range(0, 70, 7):
        byte, at = _byte(content, at)
        value |= (byte & 127) << shift
        if byte < 128:
            return value, at
    raise ValueError("a header has a number of too many digits")


def _number(content: bytes, at: int) -> tuple[int, int]:
    """Return a number whose sign is its last bit, and the offset of its end."""
    value, at = _varint(content, at)
    return (value >> 1) ^ -(value & 1), at


# The column chunks listed in the footer of a Parquet file (Apache Parquet format, ``FileMetaData``), and their pages.
#
# They are read here because pyarrow crashes the process if a damaged footer contradicts itself about a column.
