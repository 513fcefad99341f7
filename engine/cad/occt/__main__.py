"""Read one STEP file in a process of its own: a broken file can crash OCCT, or keep it busy for ever.

Arguments: a folder with ``input.step``, where ``assembly.npz`` or ``refusal.txt`` is written; the file's SHA-256; the
recognition gap [mm]; bytes of memory; seconds of processor time.
"""

import ctypes
import os
import resource
import signal
import sys
from contextlib import suppress
from pathlib import Path

_DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG of Linux


def main() -> None:
    """Read the file that the arguments name."""
    parent = os.getppid()
    folder, sha256, recognition, memory, seconds = sys.argv[1:]
    _limit(int(memory), int(seconds), parent)
    try:
        refusal = _read(Path(folder), sha256, float(recognition))
    except MemoryError:
        refusal = (
            f"takes more than {int(memory) / 2**30:g} GiB of memory to read; export only the parts of the mechanism"
        )
    if refusal:
        Path(folder, "refusal.txt").write_text(refusal, "utf-8")


def _read(folder: Path, sha256: str, recognition: float) -> str:
    """Write what is in the file; return why it cannot be read, else an empty text."""
    from engine.cad.archive import packed
    from engine.cad.occt.step_assembly import read_assembly
    from engine.cad.occt.step_document import UnreadableStep

    try:
        assembly = read_assembly(folder / "input.step", sha256, recognition)
    except UnreadableStep as error:
        return str(error)
    (folder / "assembly.npz").write_bytes(packed(assembly))
    return ""


def _limit(memory: int, seconds: int, parent: int) -> None:
    """Limit what this process can take, and let it end with the one that started it."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    for kind, limit in ((resource.RLIMIT_DATA, memory), (resource.RLIMIT_CPU, seconds)):
        hard = resource.getrlimit(kind)[1]
        resource.setrlimit(kind, (limit if hard == resource.RLIM_INFINITY else min(limit, hard), hard))
    with suppress(OSError, AttributeError):  # Linux only; elsewhere the limit of processor time ends it
        ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGKILL)
        if os.getppid() != parent:
            os._exit(1)


if __name__ == "__main__":
    main()
