"""Answer one question about a STEP file in a separate process, because a broken file can crash or block OCCT.

Arguments: a folder with ``input.step`` and ``question.json``, in which ``answer`` or ``refusal.txt`` is written; the
limits of memory [bytes] and processor time [s]. The question has one of two keys: ``assembly``, a table with the file's
``sha256`` and the largest ``recognition`` gap [mm], or ``distances``, a list of pairs of shapes.
"""

import ctypes
import json
import os
import resource
import signal
import sys
from contextlib import suppress
from pathlib import Path

_DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG of Linux


def main() -> None:
    """Answer the question in the folder."""
    parent = os.getppid()
    folder, memory, seconds = sys.argv[1:]
    _limit(int(memory), int(seconds), parent)
    try:
        refusal = _answer(Path(folder))
    except MemoryError:
        refusal = (
            f"takes more than {int(memory) / 2**30:g} GiB of memory to read; export only the parts of the mechanism"
        )
    if refusal:
        Path(folder, "refusal.txt").write_text(refusal, "utf-8")


def _answer(folder: Path) -> str:
    """Write the answer; return the reason if there is none, otherwise an empty text."""
    from engine.cad.archive import packed
    from engine.cad.occt.shape_distances import measure_distances
    from engine.cad.occt.step_assembly import read_assembly
    from engine.cad.occt.step_document import UnreadableStep

    path, question = folder / "input.step", json.loads((folder / "question.json").read_text("utf-8"))
    try:
        if "distances" in question:
            answer = json.dumps(measure_distances(path, question["distances"])).encode()
        else:
            answer = packed(read_assembly(path, **question["assembly"]))
    except UnreadableStep as error:
        return str(error)
    (folder / "answer").write_bytes(answer)
    return ""


def _limit(memory: int, seconds: int, parent: int) -> None:
    """Limit the resources of this process, and make it end with its parent process."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    for kind, limit in ((resource.RLIMIT_DATA, memory), (resource.RLIMIT_CPU, seconds)):
        hard = resource.getrlimit(kind)[1]
        resource.setrlimit(kind, (limit if hard == resource.RLIM_INFINITY else min(limit, hard), hard))
    with suppress(OSError, AttributeError):  # Linux only; elsewhere the limit of processor time ends it
        ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGKILL)
        if os.getppid() != parent:  # the parent had ended before the signal was asked for
            os._exit(1)


if __name__ == "__main__":
    main()
