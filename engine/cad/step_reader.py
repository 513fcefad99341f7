"""Read a STEP file: once, in a process of its own, with limits; from then on from the user's cache."""

import hashlib
import os
import signal
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from engine.cad.archive import unpacked
from engine.cad.assembly_cache import cached, keep
from engine.cad.cad_model import CadAssembly
from engine.errors import CadError
from engine.file_kinds import content_kind
from engine.regular_file import read_regular_file

RECOGNITION = 1e-4
"""Largest recognition gap [mm], unless another is asked for."""

_BEGINNING, _END = b"ISO-10303-21;", b"END-ISO-10303-21;"

_TOO_SLOW = "OCCT needs more than {} s to read it; export only the parts of the mechanism"


@dataclass(frozen=True)
class ReadingLimits:
    """What reading one CAD file may take."""

    file_bytes: int = 100 * 2**20
    memory_bytes: int = 4 * 2**30
    seconds: int = 600


def read_step(
    path: str | Path, recognition: float = RECOGNITION, limits: ReadingLimits = ReadingLimits()
) -> CadAssembly:
    """Read a STEP file.

    Parameters
    ----------
    path : str or Path
        The file: AP203, AP214 or AP242, not compressed.
    recognition : float
        Largest distance [mm] between a spline and the plane, cylinder, cone, sphere or circle that it is taken for;
        0 takes none for another.
    limits : ReadingLimits
        What reading may take.

    Returns
    -------
    CadAssembly
        All lengths in mm.

    Raises
    ------
    CadError
        If the file cannot be read, is no STEP, holds no shapes, takes too much time or memory or crashes OCCT, or if
        OCCT is not installed. The message names the file, what is wrong and what to do.
    """
    content = _content(path, limits)
    sha256 = hashlib.sha256(content).hexdigest()
    if (known := cached(sha256, recognition)) is not None:
        return known
    if find_spec("OCP") is None:
        raise CadError(f"{path}: reading CAD files needs OCCT, which is not installed; pip install 'clearcap[cad]'")
    with tempfile.TemporaryDirectory(prefix="clearcap-cad-") as folder:
        Path(folder, "input.step").write_bytes(content)
        del content
        result = _read_apart(path, Path(folder), sha256, recognition, limits)
    keep(sha256, recognition, result)
    return unpacked(CadAssembly, result)


def _content(path: str | Path, limits: ReadingLimits) -> bytes:
    """Return the content of a file that begins and ends as STEP does."""
    try:
        content = read_regular_file(path, limits.file_bytes)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise CadError(f"{path}: cannot be read ({reason.lower()}); give a STEP file{_smaller(reason)}") from None
    if _BEGINNING not in content[:1000]:
        kind = content_kind(content, "STEP") if content else "is empty; give a STEP file"
        raise CadError(f"{path}: {kind or 'is no STEP file: it does not begin with ISO-10303-21; export it as STEP'}")
    if _END not in content[-1000:]:
        raise CadError(f"{path}: was cut off: it does not end with {_END.decode()} Export or copy it again")
    return content


def _smaller(reason: str) -> str:
    """Return what to do about a file that is too large."""
    return " with only the parts of the mechanism" if "bytes" in reason else ""


def _read_apart(path: str | Path, folder: Path, sha256: str, recognition: float, limits: ReadingLimits) -> bytes:
    """Return what the process that reads has written."""
    # Modules come from where this process has its own, and never from the current folder.
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(os.path.isabs, sys.path))}
    words = [folder, sha256, repr(float(recognition)), limits.memory_bytes, limits.seconds]
    try:
        ended = subprocess.run(
            [sys.executable, "-P", "-m", "engine.cad.occt", *map(str, words)],
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            timeout=limits.seconds,
        )
    except subprocess.TimeoutExpired:
        raise CadError(f"{path}: {_TOO_SLOW.format(limits.seconds)}") from None
    if (result := folder / "assembly.npz").exists() and ended.returncode == 0:
        return result.read_bytes()
    if (refusal := folder / "refusal.txt").exists():
        raise CadError(f"{path}: {refusal.read_text('utf-8')}")
    raise CadError(f"{path}: {_crash(ended, limits)}")


def _crash(ended: "subprocess.CompletedProcess[bytes]", limits: ReadingLimits) -> str:
    """Return what became of a process that ended without a result."""
    if ended.returncode == -signal.SIGXCPU:
        return _TOO_SLOW.format(limits.seconds)
    if ended.returncode < 0:
        name = signal.Signals(-ended.returncode).name
        return f"OCCT crashed while it read it ({name}); export it again, with other settings or fewer parts"
    *_, last = ["it said nothing", *ended.stderr.decode(errors="replace").strip().splitlines()]
    if last.startswith(("ImportError", "ModuleNotFoundError")):
        return f"the OCCT that is installed is not the one that is needed ({last}); pip install 'clearcap[cad]'"
    return f"OCCT failed to read it ({last}); export it again, as AP242 or AP214"
