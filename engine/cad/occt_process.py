"""Ask OCCT about a STEP file in a separate process with limits, because a broken file can crash or block it."""

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from engine.errors import CadError

_TOO_SLOW = "OCCT needs more than {} s to read it; export only the parts of the mechanism"


_SHAPES = "its shapes", "repair the parts in the CAD system, and export them again, as AP242 or AP214"
_LIMITS = "its dimensions", "export it again without PMI, and give the limits in the campaign file"
_MATERIALS = "names and materials", "export it again without materials, and give each body its density"
_STAGES = {
    "size_limits": _LIMITS,
    "deviation_signs": _LIMITS,
    "density_unit": _MATERIALS,
    "document_labels": _MATERIALS,
    "product_tree": ("its assembly", "export it again, as AP242 or AP214, with fewer levels"),
}
"""What the modules of `engine.cad.occt` read, and the remedy if they fail."""


@dataclass(frozen=True)
class ReadingLimits:
    """The limits of time and memory for reading one CAD file."""

    file_bytes: int = 100 * 2**20
    memory_bytes: int = 4 * 2**30
    seconds: int = 600


USUAL_LIMITS = ReadingLimits()


def ask_occt(path: str | Path, content: bytes, question: Mapping[str, Any], limits: ReadingLimits) -> bytes:
    """Return the answer of `engine.cad.occt` to a question, see its `__main__`, about the content of a STEP file.

    The path is only named in messages. Raises CadError if OCCT is not installed, refuses the file, crashes, or takes
    too much time or memory.
    """
    if find_spec("OCP") is None:
        raise CadError(f"{path}: reading CAD files needs OCCT, which is not installed; pip install 'clearcap[cad]'")
    with tempfile.TemporaryDirectory(prefix="clearcap-cad-") as name:
        folder = Path(name)
        (folder / "input.step").write_bytes(content)
        (folder / "question.json").write_text(json.dumps(question), "utf-8")
        return _answer(path, folder, limits)


def _answer(path: str | Path, folder: Path, limits: ReadingLimits) -> bytes:
    """Return what the process wrote into its folder."""
    # Modules are found where this process finds its own, and never in the current folder.
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(os.path.isabs, sys.path))}
    words = [folder, limits.memory_bytes, limits.seconds]
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
    if (answer := folder / "answer").exists() and ended.returncode == 0:
        return answer.read_bytes()
    if (refusal := folder / "refusal.txt").exists():
        raise CadError(f"{path}: {refusal.read_text('utf-8')}")
    raise CadError(f"{path}: {_crash(ended, limits)}")


def _crash(ended: "subprocess.CompletedProcess[bytes]", limits: ReadingLimits) -> str:
    """Return why a process ended without an answer."""
    if ended.returncode == -signal.SIGXCPU:
        return _TOO_SLOW.format(limits.seconds)
    if ended.returncode < 0:
        name = signal.Signals(-ended.returncode).name
        return f"OCCT crashed while it read it ({name}); export it again, with other settings or fewer parts"
    trace = ended.stderr.decode(errors="replace").strip()
    *_, last = ["it said nothing", *trace.splitlines()]
    if last.startswith(("ImportError", "ModuleNotFoundError")):
        return f"the OCCT that is installed is not the one that is needed ({last}); pip install 'clearcap[cad]'"
    what, remedy = next((each for module, each in _STAGES.items() if f"{module}.py" in trace), _SHAPES)
    return f"what it says of {what} is broken, and OCCT failed to read it ({last}); {remedy}"
