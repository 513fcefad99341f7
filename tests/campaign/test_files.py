"""Files are written whole or not at all, in a folder and behind a URL."""

import os
import secrets

import pytest

from campaign.errors import SpecError, StoreError
from campaign.files import Files


@pytest.fixture(params=["folder", "memory"])
def files(request, tmp_path):
    """Return a root in a folder, and one behind a URL."""
    return Files(str(tmp_path / "s") if request.param == "folder" else f"memory://{secrets.token_hex(4)}/s")


def test_write_read_rename(files):
    """What is written is read; a rename replaces; a folder that is not there has no names."""
    assert files.names("a") == []
    assert files.write("a/x", b"1")
    assert files.write("a/x", b"2")
    assert files.write("a/y", b"3")
    files.rename("a/x", "a/z")
    assert files.names("a") == ["y", "z"]
    assert files.read("a/z") == b"2"
    with pytest.raises(FileNotFoundError):
        files.read("a/x")


def test_exclusive_keeps_the_first(files):
    """Of two writers of a plan the first one wins."""
    assert files.write("plan.json", b"first", exclusive=True)
    assert not files.write("plan.json", b"second", exclusive=True)
    assert files.read("plan.json") == b"first"
    assert files.names("") == ["plan.json"]


def test_probe_leaves_nothing(files, tmp_path):
    """Checking that a store can be written writes nothing that stays, not even its folder."""
    files.check_writable()
    assert files.names("") == []
    assert list(tmp_path.iterdir()) == []


def test_failed_write_leaves_nothing(tmp_path, monkeypatch):
    """A disk that fills up leaves neither a part nor a temporary file, and one clear message."""

    def full(descriptor):
        raise OSError(28, "No space left on device")

    files = Files(str(tmp_path / "s"))
    files.write("a/x", b"before")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(StoreError, match=r"a/x cannot be written \(No space left on device\); free or repair"):
        files.write("a/x", b"after")
    assert files.names("a") == ["x"]
    assert files.read("a/x") == b"before"


def test_sweep_removes_only_temporary_files(files):
    """What a killed writer left goes, everything else stays."""
    for name in ("part-000001.parquet", "part-000002.parquet.4711-ab.tmp", "part-000003.parquet.bad"):
        files.write(f"parts/{name}", b"x")
    files.sweep("parts")
    assert files.names("parts") == ["part-000001.parquet", "part-000003.parquet.bad"]


def test_store_that_cannot_be_written(tmp_path):
    """A file in the way, a system folder, an unknown protocol: one message each."""
    (tmp_path / "file").write_text("")
    for url in (str(tmp_path / "file"), str(tmp_path / "file" / "below"), "/proc/here"):
        with pytest.raises(SpecError, match="not writable"):
            Files(url).check_writable()
    with pytest.raises(SpecError, match="nosuch"):
        Files("nosuch://bucket")
