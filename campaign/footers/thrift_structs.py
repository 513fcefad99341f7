"""Structs of the Thrift compact protocol, in which Parquet writes its footer and its page headers.

Every element takes at least one byte, so the time to read is proportional to the length of the content. Nothing is
trusted: malformed content raises ValueError.
"""

from typing import Any

DEEPEST = 12  # nested structs and lists; a footer has seven
_LONG = 15  # in the head of a list: the length follows


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
