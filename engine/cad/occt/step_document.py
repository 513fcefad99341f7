"""A STEP file as an OCCT document, and the content of its header."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from OCP.APIHeaderSection import APIHeaderSection_MakeHeader
from OCP.collections import Sequence_TCollection_AsciiString
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.Message import Message
from OCP.STEPCAFControl import STEPCAFControl_Reader
from OCP.TCollection import TCollection_ExtendedString
from OCP.TDocStd import TDocStd_Document
from OCP.XCAFDoc import XCAFDoc_DocumentTool

from engine.cad.occt.damage import Damage, damage_of
from engine.cad.occt.names_and_materials import grams_of_densities
from engine.cad.occt.size_limits import DeviationSigns, ToleranceClasses

_UNITS = {
    "millimetre": ("mm", 1.0),
    "centimetre": ("cm", 10.0),
    "metre": ("m", 1000.0),
    "micrometre": ("um", 1e-3),
    "inch": ("inch", 25.4),
    "foot": ("ft", 304.8),
}
_SCHEMAS = {"AP242": "AP242", "AUTOMOTIVE_DESIGN": "AP214", "CONFIG_CONTROL_DESIGN": "AP203"}


class UnreadableStep(Exception):
    """OCCT finds no STEP data in a file, or no shapes."""


@dataclass(frozen=True)
class StepDocument:
    """OCCT's representation of a file; lengths in mm."""

    shapes: Any
    dimensions: Any
    unit: str
    schema: str
    grams: float | None  # the unit of mass of its densities [g]; None if there are several, or if it is unknown
    signs: DeviationSigns
    classes: ToleranceClasses
    dimensions_too_large: float
    """Factor by which all its dimensions are too large. OCCT writes them in mm but declares them in the file's unit of
    length; for files of all other programs the factor is 1.
    """
    damage: Damage
    """What is lost because entities cannot be read, or refer to others that are missing or have the wrong type."""
    keep: Any  # the document, which must live as long as the tools


def open_step(path: Path, *, tolerances: bool = True) -> StepDocument:
    """Read a STEP file, with or without its dimensions and tolerances; raise UnreadableStep if it has no shapes."""
    Message.DefaultMessenger_s().ChangePrinters().Clear()
    document = TDocStd_Document(TCollection_ExtendedString("XmlXCAF"))
    XCAFDoc_DocumentTool.SetLengthUnit_s(document, 0.001)  # m: OCCT then converts all lengths to mm
    reader = STEPCAFControl_Reader()
    reader.SetGDTMode(tolerances)
    reader.SetMatMode(True)
    reader.SetNameMode(True)
    if reader.ReadFile(str(path)) != IFSelect_ReturnStatus.IFSelect_RetDone:
        raise UnreadableStep("is not a readable STEP file, or it was cut off; export or copy it again")
    unit, millimetres = _unit(reader)
    model = reader.ChangeReader().StepModel()
    header = APIHeaderSection_MakeHeader(model)
    by_occt = "Open CASCADE" in _text(header.PreprocessorVersion())
    if not reader.Transfer(document):
        raise UnreadableStep("has no shapes; export the solids of the parts")
    return StepDocument(
        shapes=XCAFDoc_DocumentTool.ShapeTool_s(document.Main()),
        dimensions=XCAFDoc_DocumentTool.DimTolTool_s(document.Main()),
        unit=unit,
        schema=_schema(header),
        grams=grams_of_densities(model),
        signs=DeviationSigns(model, millimetres, by_occt),
        classes=ToleranceClasses(model, by_occt),
        dimensions_too_large=millimetres if by_occt else 1.0,
        damage=damage_of(model, path),
        keep=(document, reader),
    )


def _unit(reader: Any) -> tuple[str, float]:
    """Return the unit of length of a file, and its size in mm."""
    lengths, angles, solid_angles = (Sequence_TCollection_AsciiString() for _ in range(3))
    reader.ChangeReader().FileUnits(lengths, angles, solid_angles)
    name = str(lengths.Value(1).ToCString()).lower() if lengths.Length() else "millimetre"
    return _UNITS.get(name, (name, 1.0))


def _schema(header: Any) -> str:
    """Return the application protocol of a file, or the text of its header instead."""
    text = _text(header.SchemaIdentifiersValue(1)) if header.NbSchemaIdentifiers() else ""
    return next((name for start, name in _SCHEMAS.items() if text.upper().startswith(start)), text[:80])


def _text(value: Any) -> str:
    return str(value.ToCString()) if value is not None else ""
