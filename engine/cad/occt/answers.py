"""Answers to questions about a STEP file, in a child process, because a broken file can crash or block OCCT."""

import json
from pathlib import Path

from engine.cad.archive import packed
from engine.cad.occt.shape_distances import measure_distances
from engine.cad.occt.step_assembly import read_assembly
from engine.platform.child import Send


def answer(request: bytes, _send: Send) -> bytes:
    """Answer one question about the file at a ``path``, as `engine.cad.step_reader` asks it.

    It has one of two more keys: ``assembly``, a table with the file's ``sha256`` and the largest ``recognition`` gap
    [mm], or ``distances``, a list of pairs of shapes.
    """
    question = json.loads(request)
    path = Path(question["path"])
    if "distances" in question:
        return json.dumps(measure_distances(path, question["distances"])).encode()
    return packed(read_assembly(path, **question["assembly"]))
