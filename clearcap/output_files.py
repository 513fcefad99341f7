"""Files that a user names: checked before the work begins, and written whole or not at all."""

import os
import secrets
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from campaign.errors import SpecError, unwritable

PLOTS, ANIMATIONS = (".png", ".svg", ".pdf"), (".gif", ".html", ".mp4")


def check_output(option: str, path: Path, endings: tuple[str, ...]) -> None:
    """Check that a file can be written; no file remains. Raises SpecError, or StoreError if the disk is at fault."""
    if path.suffix not in endings:
        raise SpecError(f"{option} {path}: unknown ending; allowed: {', '.join(endings)}; name a file with one of them")
    if path.is_dir():
        raise SpecError(f"{option} {path}: is a folder; name a file")
    if not path.parent.is_dir():
        raise SpecError(f"{option} {path}: no folder {path.parent}; make it, or name a file in another one")
    if path.suffix in ANIMATIONS:
        from clearcap.pictures.animation import can_write

        if not can_write(path.suffix):
            raise SpecError(f"{option} {path}: needs ffmpeg, which is not found; install it, or write .gif or .html")
    try:
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        message = f"{option} {path}: not writable ({error.strerror}); name a file in a folder you may write to"
        raise unwritable(message, error) from error


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside a file, with the same ending; at the end of the block it replaces the file."""
    temporary = path.with_name(f"{path.stem}.{os.getpid()}-{secrets.token_hex(4)}.tmp{path.suffix}")
    try:
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        message = f"{path}: cannot be written ({error.strerror or error}); free or repair the disk, then run again"
        raise unwritable(message, error) from error
    finally:
        temporary.unlink(missing_ok=True)
