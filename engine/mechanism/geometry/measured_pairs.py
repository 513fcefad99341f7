"""Pairs of sides whose distance OCCT measures in the CAD file: the requests to OCCT and its answers."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from engine.cad import CadEdge, CadFace
from engine.cad.step_reader import MeasuredShape, ShapePair, drawn_distances
from engine.errors import CadError
from engine.mechanism.base import is_number
from engine.mechanism.geometry.face_search import PartSearch
from engine.mechanism.geometry.geometry_certificate import DrawnGap
from engine.mechanism.geometry.plain_numbers import length

TOUCHING = 1e-7
"""Distance [mm] below which OCCT considers shapes to touch."""


def measured_feature(search: PartSearch, feature: CadFace | CadEdge) -> MeasuredShape:
    """Return a face or an edge of a part as one end of a distance; a flat face includes all faces coplanar with it."""
    if isinstance(feature, CadEdge):
        return MeasuredShape(_place(search), edges=feature.places)
    return measured_surface(search, search.pieces(feature))


def measured_surface(search: PartSearch, faces: Sequence[CadFace]) -> MeasuredShape:
    """Return faces of a part as one end of a distance, without other faces on their planes."""
    return MeasuredShape(_place(search), faces=tuple(place for face in faces for place in face.places))


def measured_point(search: PartSearch, side: Mapping[str, Any]) -> MeasuredShape | None:
    """Return a side as one end of a distance if it is a point given in plain numbers; otherwise None."""
    point = side.get("point")
    if not isinstance(point, list | tuple) or len(point) != 3 or not all(is_number(x) for x in point):
        return None
    return MeasuredShape(point=tuple(float(x) / search.millimetre for x in search.to_assembly(point)))


def _place(search: PartSearch) -> int:
    """Return the index of a part in the assembly."""
    return [each.name for each in search.assembly.parts].index(search.part)


def drawn_gaps(
    path: Path, sha256: str, pairs: Mapping[str, ShapePair], millimetre: float
) -> tuple[dict[str, DrawnGap], str]:
    """Return the distance of each pair that has one, by joint or contact, and the reason if none was measured.

    OCCT may fail to measure a file that it can read; this is no reason to refuse the mechanism. ``sha256`` is the hash
    of the CAD file, and ``millimetre`` the length of one in the mechanism's unit.
    """
    if not pairs:
        return {}, ""
    try:
        distances = drawn_distances(path, sha256, list(pairs.values()))
    except CadError as error:
        return {}, str(error)
    found = zip(pairs, distances, strict=True)
    return {key: DrawnGap(drawn=length(far * millimetre, millimetre)) for key, far in found if far > TOUCHING}, ""
