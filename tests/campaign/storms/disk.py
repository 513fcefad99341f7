"""A small disk of a test's own, that becomes full or read-only when the test says so."""

import subprocess
import time
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path

import pytest

MOUNTS = Path("/proc/self/mounts")
BUSY_FOR = 120.0  # s, in which whoever has a file open is waited for


@contextmanager
def tmpfs(folder, size, *options):
    """Mount a file system in memory; skip the test where that is not allowed."""
    folder.mkdir()
    words = ["-o", ",".join((f"size={size}", *options)), "none", str(folder)]
    done = subprocess.run(["mount", "-t", "tmpfs", *words], capture_output=True)
    if done.returncode:
        pytest.skip(f"needs root and a kernel that lets it mount a disk of its own: {done.stderr.decode().strip()}")
    try:
        yield folder
    finally:
        held = not _repeated(["umount", str(folder)])
        if held:
            subprocess.run(["umount", "-l", folder], check=True)
    assert not held, f"a process still uses {folder}"
    assert str(folder) not in MOUNTS.read_text()


def remount(folder, *options):
    """Change options of a mounted file system; return whether that was possible: an open file prevents read-only."""
    return _repeated(["mount", "-o", ",".join(("remount", *options)), str(folder)])


def fill(folder):
    """Fill a disk to the last byte; return the file that does it."""
    filler = folder / "filler"
    with suppress(OSError), filler.open("wb", buffering=0) as file:  # the last block may be taken in smaller pieces
        while True:
            file.write(bytes(1 << 16))
    with suppress(OSError), filler.open("ab", buffering=0) as file:
        while True:
            file.write(bytes(64))
    return filler


def use_up_inodes(folder):
    """Create files until there can be no more; return the folder of them."""
    crowd = folder / "crowd"
    crowd.mkdir()
    with suppress(OSError):
        for number in count():
            (crowd / str(number)).touch()
    return crowd


def _repeated(command):
    """Repeat a command until it succeeds; return whether it did in time."""
    until = time.monotonic() + BUSY_FOR
    while subprocess.run(command, capture_output=True).returncode:
        if time.monotonic() > until:
            return False
        time.sleep(0.02)
    return True
