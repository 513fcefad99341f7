"""Data files that anybody may have written: refused in one message before they fill the memory, and never quoted."""

import io
import os
import struct
import subprocess
import sys

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from campaign.errors import SpecError
from campaign.spec import data_files
from campaign.spec.data_files import read_columns, read_data_files
from campaign.spec.named_files import FolderFiles
from tests.each import each
from tests.house import ROOT


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
    monkeypatch.setattr(parquet.ParquetFile, "iter_batches", None)
    assert f"more than 1000000 rows ({rows}); keep only what the campaign needs" in refusal(path)


def test_footer_that_says_fewer_rows(tmp_path):
    """Then only so many are decoded, or it does not fit."""
    path, rows = tmp_path / "x.parquet", 3_000_000
    content = write_parquet(path, {"x": np.zeros(rows)}, row_group_size=rows)
    path.write_bytes(with_footer(content, {rows: 900_000}))
    assert len(read_columns(FolderFiles(tmp_path), path.name, ["x"])["x"]) == 900_000


IN_LITTLE_MEMORY = """\
import sys
from pathlib import Path
from campaign.spec import data_files
from campaign.spec.data_files import read_columns
from campaign.spec.named_files import FolderFiles

data_files.LARGEST_DECODED = 40_000_000
read_columns(FolderFiles(Path(sys.argv[1]).parent), Path(sys.argv[1]).name, ["x"])
"""


@pytest.mark.processes
def test_page_that_is_larger_than_its_footer_says(tmp_path):
    """The memory that decoding may take is limited, whatever the footer says."""
    path, rows = tmp_path / "x.parquet", 12_000_000
    whole = {"use_dictionary": False, "compression": "zstd", "data_page_size": 1 << 30, "row_group_size": rows}
    content = write_parquet(path, {"x": np.zeros(rows)}, write_batch_size=rows, max_rows_per_page=rows, **whole)
    path.write_bytes(with_footer(content, {rows: 900_000}))
    assert "bytes in a column" in refusal(path)
    size = parquet.ParquetFile(io.BytesIO(content)).metadata.row_group(0).column(0).total_uncompressed_size
    path.write_bytes(with_footer(content, {rows: 900_000, size: 8_000_000}))
    words = [sys.executable, "-c", IN_LITTLE_MEMORY, str(path)]
    done = subprocess.run(words, capture_output=True, text=True, cwd=ROOT)
    last = done.stderr.splitlines()[-1]
    assert last.endswith("SpecError: its content takes too much memory; keep only the columns and rows that you need")


def test_texts_are_not_decoded(tmp_path, monkeypatch):
    """A column of another type is refused by its type."""
    path = tmp_path / "x.parquet"
    write_parquet(path, {"x": ["a" * 1000] * 1000})
    monkeypatch.setattr(parquet.ParquetFile, "iter_batches", None)
    assert "column x holds string" in refusal(path)


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
    monkeypatch.setattr(data_files, "LARGEST_FILE", 1000)
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


EVERY_BYTE = """\
import sys
from pathlib import Path
from campaign.errors import SpecError
from campaign.spec.data_files import read_columns
from campaign.spec.named_files import FolderFiles
path, first = Path(sys.argv[1]), int(sys.argv[2])
content = path.read_bytes()
refused = 0
for at in range(first, len(content)):
    for change in (1, 2, 0x10, 0xFF):
        path.write_bytes(content[:at] + bytes([content[at] ^ change]) + content[at + 1 :])
        try:
            read_columns(FolderFiles(path.parent), path.name, ["x"])
        except SpecError:
            refused += 1
print(refused)
"""


@pytest.mark.processes
def test_no_byte_of_a_footer_ends_the_process(tmp_path):
    """Pyarrow aborts where the sizes of a column contradict themselves, if it is asked for them."""
    path = tmp_path / "a.parquet"
    content = write_parquet(path, {"x": [1.0, 2.0], "s": ["a", "b"]}, store_schema=False)
    first = len(content) - 8 - struct.unpack("<I", content[-8:-4])[0]
    words = [sys.executable, "-c", EVERY_BYTE, path, str(first)]
    done = subprocess.run(words, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr[-2000:]
    assert int(done.stdout) > 100
