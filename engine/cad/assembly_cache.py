"""A cache, in the user's cache folder, of what was read from CAD files."""

import hashlib
import os
import tempfile
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from engine.cad.archive import unpacked
from engine.cad.cad_model import CadAssembly
from engine.errors import FolderError
from engine.platform.build import hash_sources
from engine.platform.private_folder import private_folder

MOST_BYTES = 2**30
"""Limit for all files together; the least recently used are deleted first."""


def cached(sha256: str, recognition: float) -> CadAssembly | None:
    """Return what the same reader read from a file with this content and recognition gap [mm]; None if not cached."""
    answer = cached_answer(sha256, repr(recognition))
    with suppress(ValueError):  # the cached file is damaged
        return unpacked(CadAssembly, answer) if answer is not None else None
    return None


def cached_answer(sha256: str, question: str) -> bytes | None:
    """Return the reader's earlier answer to a question about a file with this content; None if it is not cached."""
    with suppress(FolderError, OSError, RuntimeError):  # RuntimeError: this user has no home folder
        file = _folder() / _name(sha256, question)
        answer = file.read_bytes()
        os.utime(file)  # the time of last use, by which `_make_room` chooses
        return answer
    return None


def keep(sha256: str, recognition: float, content: bytes) -> None:
    """Add what was read from a file, as `engine.cad.archive.packed`; do nothing if there is no usable folder."""
    keep_answer(sha256, repr(recognition), content)


def keep_answer(sha256: str, question: str, answer: bytes) -> None:
    """Add the reader's answer to a question about a file to the cache."""
    with suppress(FolderError, OSError, RuntimeError):
        folder = _folder()
        # renamed when complete: another process never reads half an answer
        with tempfile.NamedTemporaryFile(dir=folder, delete=False) as file:
            file.write(answer)
        os.replace(file.name, folder / _name(sha256, question))
        _make_room(folder)


def _folder() -> Path:
    """Return the cache folder, which no other user can have filled."""
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser())
    return private_folder(base, "clearcap", "cad")


def _name(sha256: str, question: str) -> str:
    """Return the name of a cached file, which depends on the content, the reader and its settings."""
    how = hashlib.sha256(f"{_reader()} {question}".encode()).hexdigest()[:16]
    return f"{sha256}-{how}"


@cache
def _reader() -> str:
    """Return what the result depends on besides the file: the code of this package, and the version of OCCT."""
    try:
        occt = version("cadquery-ocp-novtk")
    except PackageNotFoundError:
        occt = ""
    return f"{hash_sources(Path(__file__).parent)} {occt}"


def _make_room(folder: Path) -> None:
    """Remove the least recently used files until the rest is small enough."""
    files = sorted(((file.stat(), file) for file in folder.iterdir()), key=lambda each: each[0].st_mtime, reverse=True)
    total = 0
    for status, file in files:
        total += status.st_size
        if total > MOST_BYTES:
            file.unlink(missing_ok=True)
