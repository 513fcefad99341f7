"""Distances between faces, arcs and points of a CAD file as measured by OCCT, once per question."""

import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from engine.cad.assembly_cache import cached_answer, keep_answer
from engine.cad.occt_process import USUAL_LIMITS, ReadingLimits, ask_occt
from engine.cad.step_reader import step_content


@dataclass(frozen=True)
class MeasuredShape:
    """One end of a distance: faces or edges of a part as placed in the assembly, or a point."""

    part: int = -1  # index in the assembly; -1 for a point
    faces: tuple[int, ...] = ()  # indices in the part's product, as those of `edges`
    edges: tuple[int, ...] = ()
    point: tuple[float, ...] = ()  # in the assembly's frame [mm]; empty if it is not a point


ShapePair = tuple[MeasuredShape, MeasuredShape]


def drawn_distances(
    path: str | Path, sha256: str, pairs: Sequence[ShapePair], limits: ReadingLimits = USUAL_LIMITS
) -> list[float]:
    """Return the distance of each pair [mm] as drawn in the file; 0 if they touch or overlap.

    Shapes are numbered as by `engine.cad.read_step`, which also gives the hash; raises CadError as that does.
    """
    question = [[asdict(shape) for shape in pair] for pair in pairs]
    text = json.dumps(question)
    with suppress(ValueError):  # the cached answer is damaged
        if (known := cached_answer(sha256, text)) is not None:
            return _distances(known)
    answer = ask_occt(path, step_content(path, limits), {"distances": question}, limits)
    keep_answer(sha256, text, answer)
    return _distances(answer)


def _distances(answer: bytes) -> list[float]:
    """Return the numbers of an answer; raise ValueError if it contains none."""
    return [float(distance) for distance in json.loads(answer)]
