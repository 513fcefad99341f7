"""Zones for places, directions and forms that AP242 attaches to faces (semantic PMI)."""

import re
from collections.abc import Callable
from typing import Any

from OCP.collections import Sequence_TDF_Label
from OCP.XCAFDimTolObjects import XCAFDimTolObjects_GeomToleranceMatReqModif as Material
from OCP.XCAFDimTolObjects import XCAFDimTolObjects_GeomToleranceTypeValue as Shape
from OCP.XCAFDimTolObjects import XCAFDimTolObjects_GeomToleranceZoneModif as ZoneModifier
from OCP.XCAFDoc import XCAFDoc_Datum, XCAFDoc_DimTolTool, XCAFDoc_GeomTolerance

from engine.cad.cad_model import GeometricTolerance
from engine.cad.occt.names_and_materials import listed, short_text

_DECIMALS = 12  # of a mm
_NAMES = {
    "CircularityOrRoundness": "roundness",
    "Concentricity": "coaxiality",
    "ProfileOfLine": "profile of a line",
    "ProfileOfSurface": "profile of a surface",
}


def geometric_tolerances(
    tool: Any, faces_of: Callable[[Any], list[tuple[int, ...]]], too_large: float
) -> list[GeometricTolerance]:
    """Return the geometric tolerances of a file, one for each instance of the product that it is on.

    `faces_of` returns the numbers of the faces on a label, one tuple per instance; one that is on no faces has none.
    `too_large` is the factor by which all widths are too large.
    """
    found = []
    for label in listed(tool.GetGeomToleranceLabels):
        tolerance = XCAFDoc_GeomTolerance.Set_s(label).GetObject()
        if not tolerance:
            continue
        sides = Sequence_TDF_Label()
        XCAFDoc_DimTolTool.GetRefShapeLabel_s(label, sides, Sequence_TDF_Label())
        on = [faces_of(sides.Value(place)) for place in range(1, sides.Length() + 1)]
        same = [each for each in on if len(each) == len(on[0])]
        instances = [sum(each, ()) for each in zip(*same, strict=True)] or [()]
        found += [
            GeometricTolerance(
                kind=_kind(tolerance),
                zone=round(tolerance.GetValue() / too_large, _DECIMALS),
                round=tolerance.GetTypeOfValue() != Shape.XCAFDimTolObjects_GeomToleranceTypeValue_None,
                maximum_material=tolerance.GetMaterialRequirementModifier()
                == Material.XCAFDimTolObjects_GeomToleranceMatReqModif_M,
                datums=_datums(label),
                modifiers=_modifiers(tolerance),
                faces=faces,
            )
            for faces in instances
        ]
    return found


def _words(member: Any) -> str:
    """Return the last part of the name of an enumeration's member, in words."""
    text = member.name.rpartition("GeomTolerance")[2].partition("_")[2]
    return _NAMES.get(text, re.sub(r"(?<=[a-z])(?=[A-Z])|_", " ", text).lower())


def _kind(tolerance: Any) -> str:
    return _words(tolerance.GetType())


def _datums(label: Any) -> tuple[str, ...]:
    """Return the letters of the datums of a tolerance, in their order."""
    datums = [
        XCAFDoc_Datum.Set_s(each).GetObject() for each in listed(XCAFDoc_DimTolTool.GetDatumOfTolerLabels_s, label)
    ]
    placed = sorted((datum.GetPosition(), short_text(datum.GetName())) for datum in datums)
    return tuple(dict.fromkeys(name for _, name in placed if name))


def _modifiers(tolerance: Any) -> tuple[str, ...]:
    """Return what else changes the meaning of a zone, in words."""
    every = tolerance.GetModifiers()
    found = [_words(every.Value(place)) for place in range(1, every.Length() + 1)]
    if tolerance.GetMaterialRequirementModifier() == Material.XCAFDimTolObjects_GeomToleranceMatReqModif_L:
        found.append("least material requirement")
    if tolerance.GetZoneModifier() != ZoneModifier.XCAFDimTolObjects_GeomToleranceZoneModif_None:
        found.append(f"{_words(tolerance.GetZoneModifier())} zone")
    if tolerance.GetMaxValueModifier():
        found.append(f"at most {tolerance.GetMaxValueModifier():g} mm")
    return tuple(each for each in found if each != "maximum material requirement")
