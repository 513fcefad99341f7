"""Files are written whole or not at all, in a folder and behind a URL."""

import os
import random
import secrets
import shutil
import signal
import subprocess
import sys
import time

import pytest

from campaign.errors import SpecError, StoreError
from campaign.store.files.files import DEAD_AFTER, Files
from campaign.store.files.retry_policy import HASTY
from tests.each import each


@pytest.fixture(params=["folder", "memory"])
def files(request, tmp_path):
    """Return a root in a folder, and one behind a URL."""
    return Files(str(tmp_path / "s") if request.param == "folder" else f"memory://{secrets.token_hex(4)}/s")


def test_write_read_rename(files):
    """What is written is read; a rename replaces; a folder that is not there has no names."""
    assert files.names("a") == []
    files.write("a/x", b"1")
    files.write("a/x", b"2")
    files.write("a/y", b"3")
    files.move("a/x", "a/z")
    assert files.names("a") == ["y", "z"]
    assert files.read("a/z") == b"2"
    with pytest.raises(FileNotFoundError):
        files.read("a/x")


def test_exclusive_keeps_the_first(files):
    """Of two writers of a plan the first one wins."""
    assert files.create("plan.json", b"first")
    assert not files.create("plan.json", b"second")
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

    files = Files(str(tmp_path / "s"), HASTY)
    files.write("a/x", b"before")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(StoreError, match=r"a/x.*No space left on device"):
        files.write("a/x", b"after")
    assert files.names("a") == ["x"]
    assert files.read("a/x") == b"before"


@pytest.mark.processes
def test_sweep_takes_only_the_dead(tmp_path):
    """What killed writers left goes; what a living one writes, or one elsewhere may be writing, stays."""
    files, parts = Files(str(tmp_path / "s")), tmp_path / "s" / "parts"
    files.write("parts/part-000001.parquet", b"x")
    files.write("parts/part-000003.parquet.bad", b"x")
    script = f"""
import os, signal
os.fsync = lambda descriptor: os.kill(os.getpid(), signal.SIGKILL)
from campaign.store.files.files import DEAD_AFTER, Files
Files({str(tmp_path / "s")!r}).write("parts/part-000002.parquet", b"rows")
"""
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == -signal.SIGKILL
    (dead,) = parts.glob("part-000002.parquet.*.tmp")
    alive = dead.with_name(dead.name.replace(dead.name.split("-")[2], str(os.getpid())))
    elsewhere, old = parts / "part-000004.parquet.0123456789ab-1-01234567.tmp", parts / "part-000005.parquet.x.tmp"
    for path in (alive, elsewhere, old):
        path.write_bytes(b"x")
    os.utime(old, (0, os.stat(elsewhere).st_mtime - DEAD_AFTER - 5))
    files.sweep("parts")
    left = {alive.name, elsewhere.name, "part-000001.parquet", "part-000003.parquet.bad"}
    assert set(files.names("parts")) == left


@pytest.mark.processes
@pytest.mark.skipif(shutil.which("faketime") is None, reason="needs faketime: apt-get install faketime")
def test_sweep_goes_by_the_clock_that_dates_the_files(tmp_path):
    """A process whose clock is a year ahead does not take files in work for dead ones."""
    in_work = tmp_path / "parts" / "part-000004.parquet.0123456789ab-1-01234567.tmp"
    in_work.parent.mkdir()
    in_work.write_bytes(b"x")
    script = f"from campaign.store.files.files import DEAD_AFTER, Files; Files({str(tmp_path)!r}).sweep('parts')"
    subprocess.run(["faketime", "-f", "+365d", sys.executable, "-c", script], check=True)
    assert in_work.exists()


@each("name", ["../x", "a/../../x", "/etc/passwd", "a\\b", "x" * 501, "a\n", "~root"])
def test_names_stay_inside(files, name):
    """No name leads out of the root, whatever wrote it."""
    for action in (files.read, files.exists, files.remove, lambda name: files.write(name, b"")):
        with pytest.raises(StoreError, match="is not a valid file name"):
            action(name)


def test_too_large_is_refused_unread(tmp_path):
    """A file of 10 GB is refused by name and size, before it is read."""
    path = tmp_path / "manifest.json"
    with path.open("wb") as file:
        file.truncate(10 * 2**30)
    with pytest.raises(StoreError, match=r"manifest\.json.*10737418240"):
        Files(str(tmp_path)).read("manifest.json")


@pytest.fixture
def small_disk(tmp_path):
    """Return a file system of 256 kB."""
    mount = tmp_path / "small"
    mount.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(mount)], check=True)
    yield mount
    subprocess.run(["umount", str(mount)], check=True)


@pytest.mark.processes
def test_full_disk(small_disk):
    """What does not fit is not there at all, what was there stays, and the message says what to do."""
    files = Files(str(small_disk), HASTY)
    files.write("parts/a", b"a" * 100_000)
    for _ in range(3):
        with pytest.raises(StoreError, match=r"parts/b.*No space left on device"):
            files.write("parts/b", b"b" * 200_000)
    assert files.names("parts") == ["a"]
    assert files.read("parts/a") == b"a" * 100_000
    files.write("parts/b", b"b" * 100_000)


@pytest.mark.processes
def test_read_only_store(small_disk):
    """A store that is mounted read-only can be read, and is refused by name for writing."""
    files = Files(str(small_disk), HASTY)
    files.write("parts/a", b"a")
    subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
    assert files.read("parts/a") == b"a"
    with pytest.raises(StoreError, match="Read-only file system"):
        files.check_writable()
    with pytest.raises(StoreError, match=r"parts/a.*Read-only file system"):
        files.write("parts/a", b"b")


@pytest.mark.processes
@pytest.mark.parametrize("seed", range(20))
def test_killed_writer_leaves_all_or_nothing(tmp_path, seed):
    """Kill -9 at a random moment: each file is the old one or the new one, whole; besides only temporary ones."""
    script = f"""
from campaign.store.files.files import DEAD_AFTER, Files
files, count = Files({str(tmp_path)!r}), 0
print("go", flush=True)
while True:
    files.write(f"parts/{{count % 3}}", bytes([count % 251]) * 300_000)
    count += 1
"""
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE) as writer:
        writer.stdout.readline()
        time.sleep(random.Random(seed).uniform(0.0, 0.05))
        writer.kill()
    files = Files(str(tmp_path))
    names = [name for name in files.names("parts") if not name.endswith(".tmp")]
    assert set(names) <= {"0", "1", "2"}
    for name in names:
        content = files.read(f"parts/{name}")
        assert len(content) == 300_000
        assert len(set(content)) == 1
    files.sweep("parts")
    assert files.names("parts") == names


@pytest.mark.processes
def test_two_writers_of_one_file(tmp_path):
    """Two processes that write the same file in the same moment leave one of the two contents."""
    script = """
import sys
from campaign.store.files.files import DEAD_AFTER, Files
files = Files(sys.argv[1])
for _ in range(100):
    files.write("x", sys.argv[2].encode() * 100_000)
"""
    command = [sys.executable, "-c", script, str(tmp_path)]
    writers = [subprocess.Popen([*command, letter]) for letter in "ab"]
    seen = set()
    while any(writer.poll() is None for writer in writers):
        if (tmp_path / "x").exists():
            seen.add((tmp_path / "x").read_bytes())
    assert [writer.wait() for writer in writers] == [0, 0]
    assert seen <= {b"a" * 100_000, b"b" * 100_000}
    assert Files(str(tmp_path)).names("") == ["x"]


def test_store_that_cannot_be_written(tmp_path):
    """A file in the way, a system folder, an unknown protocol: one message each."""
    (tmp_path / "file").write_text("")
    for url in (str(tmp_path / "file"), str(tmp_path / "file" / "below"), "/proc/here"):
        with pytest.raises(SpecError, match="not writable"):
            Files(url).check_writable()
    with pytest.raises(SpecError, match="nosuch"):
        Files("nosuch://bucket")
