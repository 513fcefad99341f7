"""Find a face or edge of a part by its position, and what it gives a side of a joint or contact, as plain numbers.

Exactly one must fit, otherwise the candidates are listed. Numbers are rounded so that differences in the arithmetic of
machines do not show.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import log10
from typing import Any, TypeVar

import numpy as np

from engine.arrays import Array
from engine.cad import CadAssembly, CadEdge, CadFace
from engine.cad.geometry import distance_to_triangles
from engine.mechanism.base import TableModel
from engine.mechanism.geometry.cad_table import FeatureKind, NearEdge, NearPlace, RoundFace

DECIMALS = 12
"""Decimals of a length in mm and of a component of a direction; significant digits of masses and inertias."""

WITHIN = 0.5
"""Largest distance of a point from its face [mm], unless the file sets another."""

SAME_RADIUS = 1e-3
"""Largest difference between a face's radius and the one given [mm]."""

COPLANAR = 1e-6
"""Largest distance [mm] and angle [rad] between faces that count as one plane."""

_LISTED = 6  # largest number of candidates in a message
_T = TypeVar("_T", CadFace, CadEdge)

ENDLESS_AGAINST = {"hole": ("ring",), "pin": ("ring", "plane", "disc", "rectangle")}
"""For each kind of side, the primitives opposite to it for which the ends of a bore or a cylinder do not count."""


def length(value: float, millimetre: float) -> float:
    """Return a length rounded to 1e-12 mm; ``millimetre`` is the length of a millimetre in its unit."""
    return round(float(value), DECIMALS - round(log10(millimetre))) + 0.0


def lengths(values: Array, millimetre: float) -> list[float]:
    """Return lengths, shape (n,), rounded to 1e-12 mm, without negative zeros."""
    return [length(value, millimetre) for value in values]


def direction(values: Array) -> list[float]:
    """Return the rounded components of a unit vector."""
    return [round(float(value), DECIMALS) + 0.0 for value in values]


def significant(values: Array) -> Array:
    """Return numbers of one quantity, of any shape, rounded to the decimals that the largest of them needs."""
    largest = float(np.abs(values).max())
    decimals = DECIMALS - 1 - int(np.floor(log10(largest))) if largest > 0 else 0
    return np.round(values, decimals) + 0.0


# Find a face or edge of a part by its position: exactly one must fit, otherwise the candidates are listed.


class NotOneFace(Exception):
    """None or several faces fit; the message lists the candidates."""


@dataclass(frozen=True)
class PartSearch:
    """Searches the faces and edges of one part."""

    assembly: CadAssembly  # in the unit of length of the mechanism
    part: str
    millimetre: float  # its length in that unit

    def to_assembly(self, point: Sequence[float]) -> Array:
        """Return a point in the assembly's frame, given in the body's frame."""
        placement = self.assembly.part(self.part).placement
        return np.asarray(placement.rotation @ np.asarray(point, float) + placement.translation)

    def to_body(self, point: Array) -> list[float]:
        """Return a point in the body's frame, given in the assembly's frame."""
        placement = self.assembly.part(self.part).placement
        return lengths(placement.rotation.T @ (point - placement.translation), self.millimetre)

    def placed_in_body(self, points: Array) -> Array:
        """Return points in the body's frame, given in the assembly's frame, shape (..., 3)."""
        placement = self.assembly.part(self.part).placement
        return np.asarray((points - placement.translation) @ placement.rotation)

    def turned_to_body(self, vector: Array) -> list[float]:
        """Return a direction in the body's frame, given in the assembly's frame."""
        return direction(self.assembly.part(self.part).placement.rotation.T @ vector)

    def round_face(self, wanted: RoundFace, *, hollow: bool) -> CadFace:
        """Return the hole or pin of a given radius near a point; raise NotOneFace if there is not exactly one."""
        faces = [
            face for face in self.assembly.faces_of(self.part) if face.kind == "cylinder" and face.hollow == hollow
        ]
        near = self.to_assembly(wanted.near)
        far = [(_to_axis(face, near), face) for face in faces]
        same = [
            (distance, face)
            for distance, face in far
            if abs(face.radius - wanted.radius) <= SAME_RADIUS * self.millimetre
        ]
        return self._only(wanted, same, far, "hole" if hollow else "pin")

    def plane(self, wanted: NearPlace) -> CadFace:
        """Return the flat face near a point; coplanar faces count as one. Raise NotOneFace unless there is just one."""
        faces = [face for face in self.assembly.faces_of(self.part) if face.kind == "plane"]
        near = self.to_assembly(wanted.near)
        far = sorted(
            ((distance_to_triangles(near, self._triangles(face)), face) for face in faces), key=lambda each: each[0]
        )
        pieces: list[tuple[float, CadFace]] = []
        for distance, face in far:
            if not any(self._is_same_plane(face, other) for _, other in pieces):
                pieces.append((distance, face))
        return self._only(wanted, pieces, pieces, "flat face")

    def pieces(self, face: CadFace) -> list[CadFace]:
        """Return the faces of the part coplanar with a flat face, itself included; of another face, only itself."""
        if face.kind != "plane":
            return [face]
        flat = (each for each in self.assembly.faces_of(self.part) if each.kind == "plane")
        return [each for each in flat if self._is_same_plane(each, face)]

    def face(self, wanted: NearPlace) -> CadFace:
        """Return the face of any kind near a point; raise NotOneFace if there is not exactly one."""
        near = self.to_assembly(wanted.near)
        far = [(distance_to_triangles(near, self._triangles(face)), face) for face in self.assembly.faces_of(self.part)]
        return self._only(wanted, far, far, "face")

    def edge(self, wanted: NearPlace) -> CadEdge:
        """Return the circular edge near a point; raise NotOneFace if there is not exactly one."""
        near = self.to_assembly(wanted.near)
        far = [(_to_arc(edge, near), edge) for edge in self.assembly.edges if edge.part == self.part]
        return self._only(wanted, far, far, "circular edge")

    def _only(
        self, wanted: NearPlace, fitting: Iterable[tuple[float, _T]], all_of_kind: Iterable[tuple[float, _T]], what: str
    ) -> _T:
        """Return the only candidate that is near enough."""
        within = WITHIN * self.millimetre if wanted.within is None else wanted.within
        fits = [found for distance, found in fitting if distance <= within]
        if len(fits) == 1:
            return fits[0]
        candidates = sorted(all_of_kind, key=lambda each: each[0])
        described = self.described if what == "face" else self._described
        listed = "; ".join(f"{described(found)}, {distance:.3g} away" for distance, found in candidates[:_LISTED])
        others = f"; and {len(candidates) - _LISTED} more" if len(candidates) > _LISTED else ""
        count = f"{len(fits)} fit" if fits else "none fits"
        found = f"these, nearest first: {listed}{others}" if candidates else f"no {what}"
        keys = "radius and near" if isinstance(wanted, RoundFace) else "near"
        raise NotOneFace(
            f"{count} within {within:g}; {self.part} has {found}; allowed: exactly one {what}; correct {keys}, or give"
            " within"
        )

    def described(self, found: CadFace | CadEdge) -> str:
        """Return a description of a face: its kind and a point on it."""
        kind = found.kind if isinstance(found, CadFace) and found.kind != "surface" else "free-form face"
        at = found.on if isinstance(found, CadFace) else found.centre
        return f"the {kind} at near = {_short(self.to_body(at))}"

    def _described(self, found: CadFace | CadEdge) -> str:
        """Return a face or edge in the form in which a file would name it."""
        if isinstance(found, CadFace) and found.kind == "plane":
            return f"near = {_short(self.to_body(found.on))} with normal {_short(self.turned_to_body(found.normal))}"
        if isinstance(found, CadFace):
            return f"radius = {found.radius:.7g}, near = {_short(self.to_body(found.point))}"
        at = found.centre + found.radius * (found.middle if found.middle.any() else _across(found.axis))
        return f"near = {_short(self.to_body(at))} of radius {found.radius:.7g}"

    def _triangles(self, face: CadFace) -> Array:
        """Return the corners of a face's triangles, shape (n, 3, 3)."""
        mesh = next(mesh for mesh in self.assembly.meshes if mesh.part == self.part)
        return np.asarray(mesh.vertices[mesh.triangles[mesh.faces == face.number]])

    def _is_same_plane(self, face: CadFace, other: CadFace) -> bool:
        apart = abs(float(other.normal @ (face.on - other.on)))
        turned = float(np.linalg.norm(face.normal - other.normal))
        return apart <= COPLANAR * self.millimetre and turned <= COPLANAR


def _to_axis(face: CadFace, point: Array) -> float:
    """Return the distance of a point from the segment of the axis that a face spans."""
    along = float(face.axis @ (point - face.point))
    nearest = face.point + np.clip(along, *face.extent) * face.axis
    return float(np.linalg.norm(point - nearest))


def _to_arc(edge: CadEdge, point: Array) -> float:
    """Return the distance of a point from a circular edge."""
    offset = point - edge.centre
    across = offset - (offset @ edge.axis) * edge.axis
    length = float(np.linalg.norm(across))
    outward = across / length if length > 0 else _across(edge.axis)
    if edge.middle.any() and float(outward @ edge.middle) < np.cos(edge.span / 2):
        side = np.sign(float(np.cross(edge.axis, edge.middle) @ outward)) or 1.0
        turned = side * np.cross(edge.axis, edge.middle)
        outward = np.cos(edge.span / 2) * edge.middle + np.sin(edge.span / 2) * turned
    return float(np.linalg.norm(offset - edge.radius * outward))


def _across(axis: Array) -> Array:
    """Return a unit vector perpendicular to another vector."""
    across = np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])
    return np.asarray(across / np.linalg.norm(across))


def _short(values: Sequence[float]) -> str:
    return f"[{', '.join(f'{round(value, 6) + 0.0:g}' for value in values)}]"


# Sides of joints and contacts that name faces of a CAD file: the point, axis, radius or primitive of the face.


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
