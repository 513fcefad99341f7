"""Read STEP files into plain numbers. OCCT, the extra ``clearcap[cad]``, runs only in the reading process."""

from engine.cad.cad_model import CadAssembly, CadEdge, CadFace, CadPart, SplineSurface, in_unit
from engine.cad.step_reader import RECOGNITION, ReadingLimits, read_step

__all__ = [
    "RECOGNITION",
    "CadAssembly",
    "CadEdge",
    "CadFace",
    "CadPart",
    "ReadingLimits",
    "SplineSurface",
    "in_unit",
    "read_step",
]
