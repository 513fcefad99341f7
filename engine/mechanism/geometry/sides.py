"""Sides of joints and contacts that name faces of a CAD file: the point, axis, radius or primitive of the face."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from engine.arrays import Array
from engine.cad import CadEdge, CadFace
from engine.mechanism.base import TableModel
from engine.mechanism.geometry.cad_table import FeatureKind, NearEdge, NearPlace, RoundFace
from engine.mechanism.geometry.face_search import PartSearch
from engine.mechanism.geometry.plain_numbers import length

ENDLESS_AGAINST = {"hole": ("ring",), "pin": ("ring", "plane", "disc", "rectangle")}
"""For each kind of side, the primitives opposite to it for which the ends of a bore or a cylinder do not count."""


def feature_of(search: PartSearch, kind: FeatureKind, wanted: TableModel) -> CadFace | CadEdge:
    """Return the face or edge that a selector names; raise NotOneFace if there is not exactly one."""
    match wanted:
        case RoundFace():
            return search.round_face(wanted, hollow=kind == "hole")
        case NearEdge():
            return search.edge(wanted.edge)
        case NearPlace():
            return search.plane(wanted)
    raise TypeError(f"{type(wanted).__name__} selects no face")


def axis_of(face: CadFace) -> Array:
    """Return the direction of a face's axis in the assembly, signed so that its largest component is positive."""
    largest = face.axis[int(np.abs(face.axis).argmax())]
    return face.axis if largest > 0 else -face.axis


def contact_side(search: PartSearch, kind: FeatureKind, feature: CadFace | CadEdge, other: str) -> dict[str, Any]:
    """Return the primitive, under its key, for the feature that a side of a contact selects; ``other`` is opposite."""
    if isinstance(feature, CadEdge):
        arc = {
            "centre": search.to_body(feature.centre),
            "normal": search.turned_to_body(feature.axis),
            "radius": length(feature.radius, search.millimetre),
        }
        part = {"middle": search.turned_to_body(feature.middle), "half_angle": feature.span / 2}
        return {"arc": arc | (part if feature.middle.any() else {})}
    if kind == "plane":
        return {"plane": {"point": search.to_body(feature.on), "normal": search.turned_to_body(feature.normal)}}
    cylinder = {
        "point": search.to_body(feature.point),
        "axis": search.turned_to_body(axis_of(feature)),
        "radius": length(feature.radius, search.millimetre),
    }
    if other not in ENDLESS_AGAINST[kind]:
        cylinder["half_length"] = length(np.ptp(feature.extent) / 2, search.millimetre)
    return {"bore" if kind == "hole" else "cylinder": cylinder}


def line_side(search: PartSearch, side: Mapping[str, Any], at: Array, axis: Array) -> dict[str, Any]:
    """Return the side of a joint about an axis, completed with point and axis; existing entries are kept.

    ``at`` and ``axis`` are in the assembly's frame.
    """
    return {"point": search.to_body(at), "axis": search.turned_to_body(axis), **side}
