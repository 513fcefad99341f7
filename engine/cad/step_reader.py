"""Read a STEP file, and measure distances in it, in a separate process with limits, which OCCT can crash or block.

Each question is asked once; afterwards its answer comes from the user's cache.
"""

import hashlib
import json
import re
import signal
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from engine.cad.archive import cached, cached_answer, keep_answer, unpacked
from engine.cad.cad_model import CadAssembly
from engine.errors import CadError
from engine.faults.file_kinds import content_kind
from engine.platform.child import Child, ChildEnded, ChildRaised, Limits, within_own
from engine.platform.regular_file import read_regular_file

_FUNCTION = "engine.cad.occt.answers:answer"

_SHAPES = "its shapes", "repair the parts in the CAD system, and export them again, as AP242 or AP214"
_MATERIALS = "names and materials", "export it again without materials, and give each body its density"
_STAGES = {
    "names_and_materials": _MATERIALS,
    "product_tree": ("its assembly", "export it again, as AP242 or AP214, with fewer levels"),
}
"""What the modules of `engine.cad.occt` read, and the remedy if they fail."""

RECOGNITION = 1e-4  # default of the largest recognition gap [mm]

_TOLERANCES = b"DIMENSIONAL_SIZE", b"DIMENSIONAL_LOCATION", b"TOLERANCE"
"""Words of files with dimensions and tolerances, without which one is read again if OCCT fails."""

_BEGINNING, _END = b"ISO-10303-21;", b"END-ISO-10303-21;"


@dataclass(frozen=True)
class ReadingLimits:
    """The limits of time and memory for reading one CAD file."""

    file_bytes: int = 100 * 2**20
    memory_bytes: int = 4 * 2**30
    seconds: int = 600  # of the processor


USUAL_LIMITS = ReadingLimits()
_WAIT = 10  # s in which a processor that others use, too, is given to OCCT for one second


class OcctFailed(CadError):
    """OCCT crashed, or did what nobody foresaw."""


def ask_occt(path: str | Path, content: bytes, question: Mapping[str, Any], limits: ReadingLimits) -> bytes:
    """Return the answer of `engine.cad.occt` to a question, see its `answers`, about the content of a STEP file.

    The path is only named in messages. Raises OcctFailed if OCCT crashes, and CadError if it is not installed, refuses
    the file, or takes too much time or memory: than the limits, or than what is left to this process.
    """
    if find_spec("OCP") is None:
        raise CadError(f"{path}: reading CAD files needs OCCT, which is not installed; pip install 'clearcap[cad]'")
    own = within_own(Limits(limits.memory_bytes, limits.seconds))
    with tempfile.TemporaryDirectory(prefix="clearcap-cad-") as folder, Child(_FUNCTION, quiet=True) as child:
        step = Path(folder, "input.step")
        step.write_bytes(as_utf8(content))
        request = json.dumps({"path": str(step), **question}).encode()
        try:
            return child.answer(request, own, _WAIT * limits.seconds)
        except (ChildEnded, ChildRaised) as error:
            why, failed = _why(error, own)
            raise (OcctFailed if failed else CadError)(f"{path}: {why}") from None


def _why(error: ChildEnded | ChildRaised, limits: Limits) -> tuple[str, bool]:
    """Return why there is no answer, and whether OCCT failed in a way that nobody foresaw."""
    if isinstance(error, ChildEnded):
        if error.was_silent or error.status == -signal.SIGXCPU:
            needed = f"more than {limits.processor_s or 0:.0f} s"
            return f"OCCT needs {needed} to read it; export only the parts of the mechanism", False
        said = f"{error}: {error.last_line:.200}" if error.last_line else f"{error}"
        return f"OCCT crashed while it read it ({said}); export it again, with other settings or fewer parts", True
    if "UnreadableStep" in error.kinds:
        return error.message, False
    if "MemoryError" in error.kinds:
        most = f"{(limits.memory or 0) / 2**30:g} GiB"
        return f"takes more than {most} of memory; export only the parts of the mechanism", False
    if "ImportError" in error.kinds:
        return f"the OCCT that is installed is not the one that is needed ({error}); pip install 'clearcap[cad]'", False
    what, remedy = next((each for module, each in _STAGES.items() if f"{module}.py" in error.trace), _SHAPES)
    return f"what it says of {what} is broken, and OCCT failed to read it ({error}); {remedy}", True


def read_step(path: str | Path, recognition: float = RECOGNITION, limits: ReadingLimits = USUAL_LIMITS) -> CadAssembly:
    """Read a STEP file (AP203, AP214 or AP242, not compressed); all lengths are in mm.

    A spline is replaced by a plane, cylinder, cone, sphere or circle that is no more than `recognition` [mm] away; 0
    replaces none. Raises CadError, which names the file, what is wrong and what to do, if it cannot be read, is not a
    STEP file, contains no shapes, exceeds the limits or crashes OCCT, or if OCCT is not installed.
    """
    content = step_content(path, limits)
    sha256 = hashlib.sha256(content).hexdigest()
    if (known := cached(sha256, recognition)) is not None:
        return known
    question = {"sha256": sha256, "recognition": recognition}
    try:
        answer = ask_occt(path, content, {"assembly": question}, limits)
    except OcctFailed:
        if not any(word in content for word in _TOLERANCES):
            raise
        answer = ask_occt(path, content, {"assembly": question | {"tolerances": False}}, limits)
    keep_answer(sha256, repr(recognition), answer)
    return unpacked(CadAssembly, answer)


def step_content(path: str | Path, limits: ReadingLimits) -> bytes:
    """Return the content of a file that starts and ends as STEP does; raise CadError for another or unreadable one."""
    try:
        content = read_regular_file(path, limits.file_bytes)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        smaller = " with only the parts of the mechanism" if "bytes" in reason else ""
        raise CadError(f"{path}: cannot be read ({reason.lower()}); give a STEP file{smaller}") from None
    if _BEGINNING not in content[:1000]:
        kind = content_kind(content, "STEP") if content else "is empty; give a STEP file"
        raise CadError(
            f"{path}: {kind or 'is not a STEP file: it lacks the first line ISO-10303-21; export it as STEP'}"
        )
    if _END not in content[-1000:]:
        raise CadError(f"{path}: was cut off: it does not end with {_END.decode()} Export or copy it again")
    return content


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
            return list(map(float, json.loads(known)))
    answer = ask_occt(path, step_content(path, limits), {"distances": question}, limits)
    keep_answer(sha256, text, answer)
    return list(map(float, json.loads(answer)))


# -- the text as UTF-8: some programs write names in the code page of their computer, and do not say so ----------------


_WITH_HIGH = re.compile(rb"[ -~\x80-\xff]*[\x80-\xff][ -~\x80-\xff]*")
_DOS_LETTERS = frozenset(range(0x80, 0xA6)) - {0x91, 0x92, 0x93, 0x96, 0x97}  # without the quotes and dashes of Windows
_LATIN_LETTERS = frozenset(range(0xC0, 0x100))
_MOSTLY = 0.75  # share of Japanese letters that are next to another one
_PRIVATE = range(0xE000, 0xF900)


def as_utf8(content: bytes) -> bytes:
    """Return a file in UTF-8; one that is neither is taken for Shift-JIS, DOS or Latin-1, by what is usual in names."""
    try:
        content.decode("utf-8")
    except UnicodeDecodeError:
        texts = _WITH_HIGH.findall(content)
        return content.decode("cp932" if _is_japanese(texts) else _western(texts), "replace").encode()
    return content


def _is_japanese(texts: list[bytes]) -> bool:
    """Return whether texts are Shift-JIS: as such, letters beyond ASCII come in words, not alone between others."""
    beyond, together = 0, 0
    for text in texts:
        try:
            letters = text.decode("cp932")
        except UnicodeDecodeError:
            return False
        if any(ord(letter) in _PRIVATE for letter in letters):
            return False
        words = re.findall(r"[^\x00-\x7f]+", letters)
        beyond += sum(map(len, words))
        together += sum(len(word) for word in words if len(word) > 1)
    return together >= _MOSTLY * beyond


def _western(texts: list[bytes]) -> str:
    """Return the code page of texts of Western Europe, from where their letters with accents are in it."""
    values = b"".join(texts)
    dos, latin = (sum(value in letters for value in values) for letters in (_DOS_LETTERS, _LATIN_LETTERS))
    if dos > latin:
        return "cp850"
    try:
        values.decode("cp1252")
    except UnicodeDecodeError:
        return "latin-1"
    return "cp1252"
