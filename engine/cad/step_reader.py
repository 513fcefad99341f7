"""Read a STEP file once, in a separate process with limits; afterwards it comes from the user's cache."""

import hashlib
from pathlib import Path

from engine.cad.archive import unpacked
from engine.cad.assembly_cache import cached, keep
from engine.cad.cad_model import CadAssembly
from engine.cad.occt_process import USUAL_LIMITS, ReadingLimits, ask_occt
from engine.errors import CadError
from engine.faults.file_kinds import content_kind
from engine.platform.regular_file import read_regular_file

RECOGNITION = 1e-4
"""Default of the largest recognition gap [mm]."""

_BEGINNING, _END = b"ISO-10303-21;", b"END-ISO-10303-21;"


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
    question = {"assembly": {"sha256": sha256, "recognition": recognition}}
    answer = ask_occt(path, content, question, limits)
    keep(sha256, recognition, answer)
    return unpacked(CadAssembly, answer)


def step_content(path: str | Path, limits: ReadingLimits) -> bytes:
    """Return the content of a file that starts and ends as STEP does; raise CadError for another or unreadable one."""
    try:
        content = read_regular_file(path, limits.file_bytes)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise CadError(f"{path}: cannot be read ({reason.lower()}); give a STEP file{_smaller(reason)}") from None
    if _BEGINNING not in content[:1000]:
        kind = content_kind(content, "STEP") if content else "is empty; give a STEP file"
        raise CadError(
            f"{path}: {kind or 'is not a STEP file: it lacks the first line ISO-10303-21; export it as STEP'}"
        )
    if _END not in content[-1000:]:
        raise CadError(f"{path}: was cut off: it does not end with {_END.decode()} Export or copy it again")
    return content


def _smaller(reason: str) -> str:
    """Return advice about a file that is too large."""
    return " with only the parts of the mechanism" if "bytes" in reason else ""
