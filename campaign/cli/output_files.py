"""Files that a user names on the command line, checked before the work begins and written whole or not at all."""

import os
import secrets
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from campaign.errors import SpecError, unwritable

TRAJECTORIES, PLOTS, ANIMATIONS = (".h5", ".hdf5"), (".png", ".svg", ".pdf"), (".gif", ".html", ".mp4")


def check_output(option: str, path: Path, endings: tuple[str, ...]) -> None:
    """Check that a file can be written; no file remains.

    Raises SpecError if the ending is not allowed, the folder does not exist or the user may not write to it; StoreError
    if the disk is full, read-only or out of reach.
    """
    if path.suffix not in endings:
        raise SpecError(f"{option} {path}: unknown ending; allowed: {', '.join(endings)}; name a file with one of them")
    if path.is_dir():
        raise SpecError(f"{option} {path}: is a folder; name a file")
    if not path.parent.is_dir():
        raise SpecError(f"{option} {path}: no folder {path.parent}; make it, or name a file in another one")
    try:
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        message = f"{option} {path}: not writable ({error.strerror}); name a file in a folder you may write to"
        raise unwritable(message, error) from error


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside a file, with the same ending; at the end of the block it replaces the file.

    Raises StoreError or SpecError if it cannot be written; an earlier file stays unchanged.
    """
    temporary = path.with_name(f"{path.stem}.{os.getpid()}-{secrets.token_hex(4)}.tmp{path.suffix}")
    try:
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        reason = error.strerror or error
        message = f"{path}: cannot be written ({reason}); free or repair the disk, then run again"
        raise unwritable(message, error) from error
    finally:
        temporary.unlink(missing_ok=True)
