"""Files in a folder of this machine, or in a folder that many machines share.

No locks are needed, because shared folders do not always support them. A file is written under a temporary name, forced
to the disk, and renamed. If two writers create the same file, the first ``link`` wins. Folders are listed anew each
time.
"""

import contextlib
import errno
import hashlib
import os
import re
import secrets
import shutil
import socket
import stat
import tempfile
import time
from pathlib import Path

from campaign.processes import process_space, started
from engine.platform.regular_file import UnfitFile, read_regular_file

RECENT = 2.0  # s; no file system has coarser timestamps
FINAL = {errno.ENOTDIR, errno.EISDIR, errno.EEXIST, errno.ENAMETOOLONG, errno.EINVAL}  # the same at every attempt


class LocalFolder:
    """Files under a folder, by their full paths; links are followed in the path of the root, and below it within it."""

    shared = True
    faults = OSError

    def __init__(self, root: str) -> None:
        self.root = os.path.abspath(os.path.expanduser(root))

    def within(self, answer_s: float) -> "LocalFolder":
        """Return these files; the operating system determines how long an operation takes."""
        return self

    def path(self, name: str) -> str:
        """Return the full path of a name, that of the root if empty; UnfitFile if a link leads out of the root."""
        path = os.path.join(self.root, name) if name else self.root
        if "/" in name:
            self._check_within(os.path.dirname(path))
        return path

    def is_final(self, error: Exception) -> bool:
        """Return whether an operation that failed like this would fail again."""
        return isinstance(error, OSError) and error.errno in FINAL

    def reopen(self) -> None:
        """Do nothing: a folder has no connection that could break."""

    def probe(self) -> None:
        """Write and remove a file in the folder, or in its nearest parent that exists."""
        existing = Path(self.root)
        while not existing.exists():
            existing = existing.parent
        with tempfile.TemporaryFile(dir=existing):
            pass

    def read(self, path: str, at_most: int) -> bytes:
        """Return a file's content; UnfitFile if it is a link, not a regular file, or longer than ``at_most`` bytes."""
        return read_regular_file(path, at_most, follow_link=False)

    def size(self, path: str) -> int:
        """Return a file's size in bytes; -1 if it is not a regular file."""
        status = os.lstat(path)
        return status.st_size if stat.S_ISREG(status.st_mode) else -1

    def names(self, path: str) -> list[str]:
        """Return the names in a folder, sorted."""
        self._check_within(path)
        try:
            return sorted(os.listdir(path))
        except (FileNotFoundError, NotADirectoryError):
            return []

    def sizes(self, path: str) -> dict[str, int]:
        """Return the size of each file in a folder, as `size` does."""
        sizes = {}
        for name in self.names(path):
            with contextlib.suppress(FileNotFoundError):  # renamed since the listing
                sizes[name] = self.size(os.path.join(path, name))
        return sizes

    def stamps(self, path: str) -> dict[str, str]:
        """Return a stamp for each file and folder in a folder; recently changed ones get a new stamp at every call."""
        # Otherwise, a second change within the same tick of the file system's clock would go unnoticed.
        self._check_within(path)
        stamps: dict[str, str] = {}
        with contextlib.suppress(FileNotFoundError, NotADirectoryError), os.scandir(path) as entries:
            for entry in entries:
                with contextlib.suppress(FileNotFoundError):  # removed since the listing
                    found = entry.stat(follow_symlinks=False)
                    stamp, now = f"{found.st_ino} {found.st_size} {found.st_mtime_ns}", time.time_ns()
                    is_recent = now - found.st_mtime_ns < RECENT * 1e9
                    stamps[entry.name] = f"{stamp} {now}" if is_recent else stamp
        return stamps

    def write(self, path: str, content: bytes) -> None:
        """Write a file whole or not at all."""
        temporary = _write_temporary(path, content)
        try:
            os.replace(temporary, path)
        except OSError:
            _discard(temporary)
            raise
        _sync_names(path)

    def create(self, path: str, content: bytes) -> bool:
        """Write a file unless it exists; return whether it was written."""
        temporary = _write_temporary(path, content)
        try:
            os.link(temporary, path)
        except FileExistsError:
            return False
        finally:
            _discard(temporary)
        _sync_names(path)
        return True

    def move(self, path: str, new: str) -> None:
        """Rename a file."""
        os.rename(path, new)
        _sync_names(new)

    def remove(self, path: str) -> None:
        """Remove a file or an empty folder; a folder that is not empty stays."""
        try:
            _discard(path)
        except (IsADirectoryError, PermissionError):  # PermissionError: some systems raise it for folders
            if not os.path.isdir(path) or os.path.islink(path):
                raise
            with contextlib.suppress(OSError):
                os.rmdir(path)

    def remove_tree(self, path: str) -> None:
        """Remove a file, or a folder with all its content; for a link, the link itself."""
        if os.path.isdir(path) and not os.path.islink(path):
            self._check_within(path)
            shutil.rmtree(path)
        else:
            _discard(path)

    def sweep(self, path: str, ending: str, dead_after: float) -> None:
        """Remove the temporary files of dead writers: of ended processes, and those older than ``dead_after`` [s]."""
        leftovers = [os.path.join(path, name) for name in self.names(path) if name.endswith(ending)]
        if not leftovers:
            return
        with tempfile.NamedTemporaryFile(dir=path, suffix=ending) as clock:
            now = os.stat(clock.name).st_mtime
        for leftover in leftovers:
            try:
                old = now - os.stat(leftover).st_mtime > dead_after
            except FileNotFoundError:
                continue
            # whether the process that began it was in this PID namespace and has ended
            writer = re.search(r"\.([0-9a-f]{12})-(\d+)-[0-9a-f]{8}\.tmp$", leftover)
            if old or (writer is not None and writer[1] == _process_space() and started(writer[2]) is None):
                _discard(leftover)

    def _check_within(self, folder: str) -> None:
        """Raise UnfitFile if links lead from the root to a folder outside of it."""
        if self._is_below_without_links(folder):  # the usual case, ten times faster than realpath
            return
        root, real = os.path.realpath(self.root), os.path.realpath(folder)
        if real != root and not real.startswith(os.path.join(root, "")):
            raise UnfitFile(errno.ELOOP, "is reached through a link that leads out of the store", folder)

    def _is_below_without_links(self, folder: str) -> bool:
        """Return whether a path leads from the root downwards without passing a link."""
        if not folder.startswith(os.path.join(self.root, "")):
            return folder == self.root
        path = self.root
        for name in folder[len(self.root) + 1 :].split(os.sep):
            path = os.path.join(path, name)
            if name == os.pardir or os.path.islink(path):
                return False
        return True


def _process_space() -> str:
    """Return an id of the PID namespace: this machine since its last boot, or a container on it."""
    return hashlib.sha256(f"{socket.gethostname()} {process_space()}".encode()).hexdigest()[:12]


def _write_temporary(path: str, content: bytes) -> str:
    """Write a temporary file beside ``path``, forced to the disk, and return its path."""
    os.makedirs(os.path.dirname(path), exist_ok=True)
    temporary = f"{path}.{_process_space()}-{os.getpid()}-{secrets.token_hex(4)}.tmp"
    try:
        with open(temporary, "xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
    except BaseException:
        _discard(temporary)
        raise
    return temporary


def _sync_names(path: str) -> None:
    """Force the entries of the folder of ``path`` to the disk; without its name, a file would be lost."""
    descriptor = os.open(os.path.dirname(path), os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _discard(path: str) -> None:
    with contextlib.suppress(FileNotFoundError):
        os.unlink(path)
