"""Only regular files are read, and never more of them than expected."""

import os
import socket

import pytest

from engine.platform.regular_file import UnfitFile, read_regular_file


def pipe(path):
    os.mkfifo(path)


def listening(path):
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(path))


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (pipe, "is a named pipe"),
        (listening, "is a socket"),
        (os.mkdir, "is a folder"),
        (lambda path: path.symlink_to("/dev/zero"), "is a device"),
        (lambda path: path.symlink_to("/dev/tty"), "is a (socket or a )?device"),
        (lambda path: path.write_bytes(b"x" * 101), "101 bytes; allowed: up to 100"),
        (lambda path: path.symlink_to(path.name), "is a symbolic link"),
    ],
)
def test_what_is_no_regular_file_is_refused(tmp_path, monkeypatch, make, reason):
    """It is named for what it is, at once: nothing is read or waited for."""
    monkeypatch.chdir(tmp_path)  # the path of a socket has at most 107 characters
    make(path := tmp_path.__class__("odd"))
    with pytest.raises(UnfitFile, match=reason):
        read_regular_file(path, 100)


def test_what_grows_is_not_read_beyond_the_limit():
    """A file that says it has 0 bytes and gives more is read up to the limit."""
    with pytest.raises(UnfitFile, match="more than 10 bytes"):
        read_regular_file("/proc/self/status", 10)


def test_regular_file_is_read(tmp_path):
    """Whole, by its name or through a link if links are allowed; what is not there is not found."""
    (file := tmp_path / "file").write_bytes(b"content")
    (link := tmp_path / "link").symlink_to(file)
    assert read_regular_file(file, 7) == read_regular_file(str(link), 7) == b"content"
    with pytest.raises(UnfitFile, match="is a symbolic link"):
        read_regular_file(link, 7, follow_link=False)
    with pytest.raises(FileNotFoundError):
        read_regular_file(tmp_path / "nothing", 7)
