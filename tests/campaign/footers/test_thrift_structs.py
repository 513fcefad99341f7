"""Structs of the compact protocol, byte by byte as its specification writes them."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from campaign.footers.thrift_structs import read_struct
from tests.each import each


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
