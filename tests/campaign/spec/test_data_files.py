"""Data files that anybody may have written: refused in one message before they fill the memory, and never quoted."""

import os
import struct
import sys

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from campaign.errors import SpecError
from campaign.spec import named_files, parquet_columns
from campaign.spec.named_files import FolderFiles, ParquetReader, read_columns, read_data_files
from engine.platform import child
from tests.each import each


def refusal(path, names=("x",)):
    """Return why a file is refused."""
    with pytest.raises(SpecError) as error:
        read_columns(FolderFiles(path.parent), path.name, list(names))
    assert len(str(error.value).splitlines()) == 1
    assert len(str(error.value)) < 2000
    return str(error.value)


def write_parquet(path, columns, **options):
    """Write a Parquet file; return its content."""
    parquet.write_table(pa.table(columns), path, **options)
    return path.read_bytes()


def varint(number, size=0):
    """Return a number as Thrift writes it, in at least ``size`` bytes."""
    number, digits = number << 1, []
    while number or len(digits) < max(size, 1):
        digits.append(number & 0x7F | 0x80)
        number >>= 7
    return bytes([*digits[:-1], digits[-1] & 0x7F])


def with_footer(content, stated):
    """Return a Parquet file whose footer says other numbers."""
    length = struct.unpack("<I", content[-8:-4])[0]
    body, footer = content[: -8 - length], content[-8 - length : -8]
    for old, new in stated.items():
        assert varint(old) in footer
        footer = footer.replace(varint(old), varint(new, len(varint(old))))
    return body + footer + content[-8:]


def test_small_parquet_file_of_many_rows_is_not_decoded(tmp_path, monkeypatch):
    """A few kilobytes of equal values: the footer says how many, and nothing is decoded."""
    path, rows = tmp_path / "x.parquet", 3_000_000
    write_parquet(path, {"x": np.zeros(rows)}, row_group_size=rows)
    assert path.stat().st_size < 30_000
    assert f"more than 1000000 rows ({rows}); keep only what the campaign needs" in refusal(path)
    monkeypatch.setattr(parquet.ParquetFile, "iter_batches", None)
    with pytest.raises(SpecError, match="more than 1000000 rows"):
        parquet_columns.read(b'["x"]\n' + path.read_bytes(), lambda *_: None)


def test_footer_that_says_fewer_rows(tmp_path):
    """Then only so many are decoded, or it does not fit."""
    path, rows = tmp_path / "x.parquet", 3_000_000
    content = write_parquet(path, {"x": np.zeros(rows)}, row_group_size=rows)
    path.write_bytes(with_footer(content, {rows: 900_000}))
    assert len(read_columns(FolderFiles(tmp_path), path.name, ["x"])["x"]) == 900_000


@pytest.mark.processes
def test_page_that_is_larger_than_its_footer_says(tmp_path, monkeypatch):
    """The memory that decoding may take is limited, whatever the footer says."""
    path, rows = tmp_path / "x.parquet", 20_000_000
    monkeypatch.setattr(named_files, "LARGEST_DECODED", 150_000_000)
    write_parquet(path, {"x": [1.0, 2.0]})
    assert read_columns(FolderFiles(tmp_path), path.name, ["x"]) == {"x": [1.0, 2.0]}
    whole = {"use_dictionary": False, "compression": "zstd", "data_page_size": 1 << 30, "row_group_size": rows}
    content = write_parquet(path, {"x": np.zeros(rows)}, write_batch_size=rows, max_rows_per_page=rows, **whole)
    path.write_bytes(with_footer(content, {rows: 900_000}))
    assert "its content takes too much memory; keep only the columns and rows that you need" in refusal(path)


def test_texts_are_not_decoded(tmp_path, monkeypatch):
    """A column of another type is refused by its type."""
    path = tmp_path / "x.parquet"
    write_parquet(path, {"x": ["a" * 1000] * 1000})
    assert "column x holds string" in refusal(path)
    monkeypatch.setattr(parquet.ParquetFile, "iter_batches", None)
    with pytest.raises(SpecError, match="column x holds string"):
        parquet_columns.read(b'["x"]\n' + path.read_bytes(), lambda *_: None)


def test_columns_are_counted(tmp_path):
    """In both formats."""
    write_parquet(tmp_path / "x.parquet", {f"x{i}": [1.0] for i in range(1001)})
    (tmp_path / "x.csv").write_text(",".join(f"x{i}" for i in range(1001)) + "\n")
    for name in ("x.parquet", "x.csv"):
        assert "more than 1000 columns (1001)" in refusal(tmp_path / name, ["x1"])


@each(
    ("content", "said"),
    [
        (b"x" * 200_000, "its first line has more than 100000 bytes"),
        (b"x\n" + b"1\n" * 1_000_002, "more than 1000001 lines"),
        (b"x\n" + b"1" * 3_000_000 + b"\n", "not csv"),
        (b"x\n" + b"1," * 1_000_000, "not csv"),
        (b'x\n"' + b"1\n" * 100_000, "column x"),
        (b"\x1f\x8b" + bytes(1000), "no column x"),
        (b"\xff\xfe" + "x\n1\n".encode("utf-16-le"), "no column x"),
        (b"x\n1\n\0\n", "column x"),
        (b"", "not csv: Empty CSV file"),
        (b"x,x\n1,2\n", "2 columns x"),
        (b"x\n", "column x"),
        (b"x\n" + b"9" * 5000 + b"\n", "column x"),
    ],
)
def test_odd_csv_is_one_message(tmp_path, content, said):
    """Whatever it holds."""
    path = tmp_path / "x.csv"
    path.write_bytes(content)
    assert said in refusal(path)


@pytest.mark.parametrize(
    "content", ["x\r\n1\r\n2\r\n", "\ufeffx\n1\n2\n", 'y,x\n"a,\nb",1\nc,2\n', "x\n1\n\n2\n", "\nx\n1\n2"]
)
def test_csv_of_other_programs(tmp_path, content):
    """Line ends of Windows, a mark before the first character, lines inside quotes, empty lines."""
    (tmp_path / "x.csv").write_text(content, newline="")
    assert read_columns(FolderFiles(tmp_path), "x.csv", ["x"]) == {"x": [1.0, 2.0]}


@pytest.mark.parametrize("name", ["pipe.csv", "zero.csv", "folder.csv", "loop.csv", "nul\0.csv", "long" * 200 + ".csv"])
def test_only_regular_files_are_read(tmp_path, name):
    """A pipe is not waited for, a device is not read."""
    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "zero.csv").symlink_to("/dev/zero")
    (tmp_path / "folder.csv").mkdir()
    (tmp_path / "loop.csv").symlink_to("loop.csv")
    raw = {"variables": {"x": {"distribution": "empirical", "file": name, "column": "x"}}}
    whole, (fault,) = read_data_files(raw, FolderFiles(tmp_path))
    assert whole == raw
    said = str(fault)
    assert said.startswith('variables.x.file = "')
    assert "cannot be read (" in said or "no such file (" in said


def test_large_file_is_not_read(tmp_path, monkeypatch):
    """The size is known before."""
    monkeypatch.setattr(named_files, "LARGEST_FILE", 1000)
    (tmp_path / "x.csv").write_text("x\n" + "1\n" * 1000)
    assert "2002 bytes; allowed: up to 1000" in refusal(tmp_path / "x.csv")


def test_a_file_elsewhere_is_not_quoted(tmp_path):
    """A campaign may name any file of the machine; what a message says of it must not tell what is in it."""
    (tmp_path / "secret").write_text("root:secret,1:secret\nroot:secret\nuser:secret,b,c\n")
    (tmp_path / "campaign").mkdir()
    (tmp_path / "campaign" / "link.csv").symlink_to(tmp_path / "secret")
    (tmp_path / "x.csv").write_text("x\n1\nroot,secret\n")
    for name, column in (("link.csv", "x"), ("link.csv", "root:secret"), ("../x.csv", "y"), ("../x.csv", "x")):
        raw = {"variables": {"x": {"distribution": "empirical", "file": name, "column": column}}}
        _, (fault,) = read_data_files(raw, FolderFiles(tmp_path / "campaign"))
        said = str(fault)
        assert "secret" not in said.replace("root:secret", "") or column in said
        assert "user" not in said
        assert "root,secret" not in said


def test_name_that_is_no_text_is_one_message(tmp_path):
    """The footer names its columns in bytes that no text has."""
    path = tmp_path / "a.parquet"
    content = write_parquet(path, {"x": [1.0], "velvet": [2.0]}, store_schema=False)
    path.write_bytes(content.replace(b"velvet", b"velve\xd6"))
    assert "not parquet" in refusal(path)


@pytest.mark.processes
def test_no_byte_of_a_footer_ends_this_process(tmp_path):
    """Pyarrow aborts where the sizes of a column contradict themselves; whatever it does, the file is refused."""
    content = write_parquet(tmp_path / "a.parquet", {"x": [1.0, 2.0], "s": ["a", "b"]}, store_schema=False)
    first = len(content) - 8 - struct.unpack("<I", content[-8:-4])[0]
    refused, seen = 0, set()
    with ParquetReader() as reader:
        for at in range(first, len(content)):
            for change in (1, 2, 0x10, 0xFF):
                try:
                    reader.columns(content[:at] + bytes([content[at] ^ change]) + content[at + 1 :], ["x"], True)
                except SpecError as error:
                    refused += 1
                    seen |= {
                        word for word in ("not parquet", "crashes its reader", "no column x") if word in str(error)
                    }
    assert refused > 100
    assert {"not parquet", "no column x"} <= seen


@pytest.mark.processes
def test_a_reader_that_is_killed_is_a_refusal(tmp_path, monkeypatch):
    """And the next file is read by another."""
    content = write_parquet(tmp_path / "a.parquet", {"x": [1.0]})
    monkeypatch.setattr(child, "command", lambda _: [sys.executable, "-c", "import os; os.kill(os.getpid(), 6)"])
    with ParquetReader() as reader:
        with pytest.raises(SpecError, match=r"crashes its reader \(SIGABRT\)"):
            reader.columns(content, ["x"], True)
        monkeypatch.undo()
        assert reader.columns(content, ["x"], True)["x"].tolist() == [1.0]
