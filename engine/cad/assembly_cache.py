"""What was read from CAD files, kept in the user's cache."""

import hashlib
import os
import tempfile
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from engine.build import hash_sources
from engine.cad.archive import unpacked
from engine.cad.cad_model import CadAssembly
from engine.errors import FolderError
from engine.private_folder import private_folder

MOST_BYTES = 2**30
"""Of all files together; the ones that were used longest ago go first."""


def cached(sha256: str, recognition: float) -> CadAssembly | None:
    """Return what was read from a file of this content before, by the same reader; None if it is not kept.

    Parameters
    ----------
    sha256 : str
        Of the file's content.
    recognition : float
        The recognition gap [mm] it was read with.
    """
    answer = cached_answer(sha256, repr(recognition))
    with suppress(ValueError):  # it was damaged
        return unpacked(CadAssembly, answer) if answer is not None else None
    return None


def cached_answer(sha256: str, question: str) -> bytes | None:
    """Return what the reader answered to a question about a file of this content before; None if it is not kept."""
    with suppress(FolderError, OSError, RuntimeError):  # RuntimeError: this user has no home
        file = _folder() / _name(sha256, question)
        answer = file.read_bytes()
        os.utime(file)
        return answer
    return None


def keep(sha256: str, recognition: float, content: bytes) -> None:
    """Keep what was read from a file; without a folder for it, nothing is kept.

    Parameters
    ----------
    sha256, recognition
        As for `cached`.
    content : bytes
        As `engine.cad.archive.packed` returned it.
    """
    keep_answer(sha256, repr(recognition), content)


def keep_answer(sha256: str, question: str, answer: bytes) -> None:
    """Keep the reader's answer to a question about a file."""
    with suppress(FolderError, OSError, RuntimeError):
        folder = _folder()
        with tempfile.NamedTemporaryFile(dir=folder, delete=False) as file:
            file.write(answer)
        os.replace(file.name, folder / _name(sha256, question))
        _make_room(folder)


def _folder() -> Path:
    """Return the folder, which nobody else can have filled."""
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser())
    return private_folder(base, "clearcap", "cad")


def _name(sha256: str, question: str) -> str:
    """Return the name of a file: what was read, by which reader, how."""
    how = hashlib.sha256(f"{_reader()} {question}".encode()).hexdigest()[:16]
    return f"{sha256}-{how}"


@cache
def _reader() -> str:
    """Return what the result depends on besides the file: the code of this package, and OCCT."""
    try:
        occt = version("cadquery-ocp-novtk")
    except PackageNotFoundError:
        occt = ""
    return f"{hash_sources(Path(__file__).parent)} {occt}"


def _make_room(folder: Path) -> None:
    """Remove the files that were used longest ago, until the rest is small enough."""
    files = sorted(((file.stat(), file) for file in folder.iterdir()), key=lambda each: each[0].st_mtime, reverse=True)
    total = 0
    for status, file in files:
        total += status.st_size
        if total > MOST_BYTES:
            file.unlink(missing_ok=True)
