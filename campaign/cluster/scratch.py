"""A folder for the temporary files of one run, closed to other users and removed however the run ends.

Dask puts its scratch folder first on the import path. By default that is ``/tmp/dask-scratch-space``, which any user of
the machine may have prepared; so each run gets a folder of its own, with an unpredictable name.
"""

import fcntl
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from campaign.errors import UnreachableError

PREFIX = "clearcap-scratch-"


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """Make a folder of mode 0700 and yield it; remove it at the end, and folders of killed runs at the start."""
    parent = Path(tempfile.gettempdir())
    _remove_abandoned(parent)
    try:
        folder, lock = _locked_folder(parent)
    except OSError as error:
        raise UnreachableError(
            f"{parent}: no folder for temporary files can be made there ({error.strerror}); free space, or set TMPDIR"
        ) from error
    try:
        yield folder
    finally:
        sys.path[:] = [entry for entry in sys.path if not Path(entry).is_relative_to(folder)]
        shutil.rmtree(folder, ignore_errors=True)
        os.close(lock)


def _locked_folder(parent: Path) -> tuple[Path, int]:
    """Return a new folder and its lock, which the system releases when this process ends."""
    while True:
        folder = Path(tempfile.mkdtemp(prefix=PREFIX, dir=parent))
        with suppress(FileNotFoundError):  # another run mistook it for abandoned before it was locked
            lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            fcntl.flock(lock, fcntl.LOCK_EX)
            if folder.exists():
                return folder, lock
            os.close(lock)


def _remove_abandoned(parent: Path) -> None:
    """Remove the folders of this user's killed runs, recognized because no process holds their locks."""
    for folder in parent.glob(f"{PREFIX}*"):
        with suppress(OSError):  # of another user, removed meanwhile, or locked by a running process
            lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            try:
                if os.fstat(lock).st_uid == os.getuid():
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    shutil.rmtree(folder, ignore_errors=True)
            finally:
                os.close(lock)
