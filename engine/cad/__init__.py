"""Read STEP files into plain numbers. OCCT, the extra ``clearcap[cad]``, runs only in the reading process."""

from engine.cad.cad_model import CadAssembly, CadEdge, CadFace, CadPart, SplineSurface
from engine.cad.occt_process import ReadingLimits
from engine.cad.step_reader import RECOGNITION, read_step
from engine.cad.unit_of_length import in_unit

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
