"""Scratch folders: closed to others, gone at the end, and after kill -9 gone at the next start."""

import os
import signal
import stat
import subprocess
import sys
import tempfile

import pytest

from campaign.cluster.local import PREFIX, scratch_folder
from campaign.errors import UnreachableError


@pytest.fixture(autouse=True)
def temporary(tmp_path, monkeypatch):
    """Have temporary files made in a folder of the test; return it."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)
    return tmp_path


def test_private_and_gone_at_the_end(temporary):
    """Whatever the umask; nothing of it stays on the path of imports, where others could put a folder of that name."""
    before, mask = list(sys.path), os.umask(0)
    try:
        with scratch_folder() as folder:
            (folder / "file").write_text("x")
            sys.path.insert(0, str(folder / "dask-scratch-space"))
            assert stat.S_IMODE(folder.stat().st_mode) == 0o700
            assert folder.parent == temporary
    finally:
        os.umask(mask)
    assert list(temporary.iterdir()) == []
    assert sys.path == before


KILLED = """
import os, signal
from campaign.cluster.local import scratch_folder
with scratch_folder() as folder:
    (folder / "left").write_text("x")
    print(folder, flush=True)
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.processes
def test_what_a_killed_run_left_is_removed_by_the_next(temporary):
    """And nothing else: not the folder of a run that lives, no file, no link, no folder of another name."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = [sys.executable, "-c", KILLED]
    done = subprocess.run(command, capture_output=True, text=True, cwd="/", env=environment)
    assert done.returncode == -signal.SIGKILL
    left = done.stdout.strip()
    assert os.path.exists(left)
    other = temporary / "other"
    other.mkdir()
    (temporary / f"{PREFIX}link").symlink_to(other)
    (temporary / f"{PREFIX}file").write_text("x")
    with scratch_folder() as first:
        assert not os.path.exists(left)
        with scratch_folder() as second:
            assert first.exists()
            assert second.exists()
    assert sorted(path.name for path in temporary.iterdir()) == [f"{PREFIX}file", f"{PREFIX}link", "other"]


def test_of_another_user(temporary):
    """Its folder is his, even if nobody locks it."""
    if os.getuid():
        pytest.skip("needs root, to make the folder of another user")
    theirs = temporary / f"{PREFIX}theirs"
    theirs.mkdir()
    os.chown(theirs, 20002, 20002)
    with scratch_folder():
        assert theirs.exists()
    theirs.rmdir()


def test_no_room(monkeypatch):
    """One message with the way out."""

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(tempfile, "mkdtemp", full)
    with pytest.raises(UnreachableError, match=r"No space left on device(?s:.*)TMPDIR"), scratch_folder():
        pass
