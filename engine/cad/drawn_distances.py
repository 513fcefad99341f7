"""Distances between faces, arcs and points of a CAD file as OCCT measures them, once for each question."""

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
    """One end of a distance: faces or edges of a part as it stands in the assembly, or a point.

    Attributes
    ----------
    part : int
        Place of the part in the assembly; -1 for a point.
    faces, edges : tuple of int
        Their places in the part's product.
    point : tuple of float
        In the assembly [mm], three coordinates; empty if it is none.
    """

    part: int = -1
    faces: tuple[int, ...] = ()
    edges: tuple[int, ...] = ()
    point: tuple[float, ...] = ()


ShapePair = tuple[MeasuredShape, MeasuredShape]


def drawn_distances(
    path: str | Path, sha256: str, pairs: Sequence[ShapePair], limits: ReadingLimits = USUAL_LIMITS
) -> list[float]:
    """Return the distance of each pair [mm], as the file draws them; 0 where they touch or overlap.

    Parameters
    ----------
    path : str or Path
        The STEP file.
    sha256 : str
        Of its content, as `engine.cad.read_step` found it.
    pairs : sequence of ShapePair
        As numbered there.
    limits : ReadingLimits
        What measuring may take.

    Raises
    ------
    CadError
        As of `engine.cad.read_step`.
    """
    question = [[asdict(shape) for shape in pair] for pair in pairs]
    text = json.dumps(question)
    with suppress(ValueError):  # what was kept is damaged
        if (known := cached_answer(sha256, text)) is not None:
            return _distances(known)
    answer = ask_occt(path, step_content(path, limits), {"distances": question}, limits)
    keep_answer(sha256, text, answer)
    return _distances(answer)


def _distances(answer: bytes) -> list[float]:
    """Return the numbers of an answer; ValueError if it holds none."""
    return [float(distance) for distance in json.loads(answer)]
