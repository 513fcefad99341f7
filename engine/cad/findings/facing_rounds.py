"""Round faces that may touch a face of another part: noses of hooks, rollers, cams and balls."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from engine.arrays import Array
from engine.cad.cad_model import CadAssembly, CadFace, Coordinates, LengthPower, Millimetres
from engine.cad.findings.extruded_profiles import ExtrudedProfile, extruded_profile
from engine.cad.findings.facing_planes import DEEPEST_OVERLAP, REACH
from engine.cad.findings.round_places import WHOLE, NearestPlace, nearest_place

Stretch = Annotated[Array, LengthPower(1)]


@dataclass(frozen=True, eq=False, kw_only=True)
class FacingRound:
    """A convex round face opposite a face of another part."""

    faces: tuple[int, int]
    """Numbers of the touched face and of the round one."""
    parts: tuple[str, str]
    """Names of the parts, in the same order."""
    gap: Millimetres
    """Distance as posed [mm]; negative where the parts overlap."""
    middle: Coordinates
    """The nearest point on the first face, shape (3,) [mm]."""
    normal: Array
    """Normal of the first face at that point, towards the second, shape (3,)."""
    stretch: Stretch
    """Start and end of the line of possible contact along the axis of a cylinder, measured from its point, shape (2,)
    [mm]; zeros for a sphere.
    """
    is_estimate: bool = False
    """Whether the gap was measured to the triangles of a free-form face."""
    profile: ExtrudedProfile | None = None
    """The profile of which the touched face is a piece, if the round face could move on to the next piece."""

    @property
    def length(self) -> float:
        """Length of the line along which a cylinder may touch [mm]; 0 for a ball."""
        return float(np.ptp(self.stretch))


def facing_rounds(
    assembly: CadAssembly, triangles: dict[int, Array], joints: Collection[frozenset[int]] = ()
) -> list[FacingRound]:
    """Return the convex cylinders and balls at most 1 mm from a face of another part, the smallest gap first.

    A cylinder is paired with planes, cylinders and free-form faces along its axis, a ball with faces of any kind. The
    closest points must lie inside both faces, not on an edge to the next face.

    `joints` has the numbers of the two faces of each pair that is a joint; these pairs are skipped.
    """
    faces = [face for face in assembly.faces if face.number in triangles]
    rounds = [face for face in faces if face.kind in ("cylinder", "sphere") and not face.hollow]
    boxes = np.array([_box(triangles[face.number]) for face in faces]).reshape(-1, 2, 3)
    sags = {mesh.part: 2 * mesh.deflection + 1e-6 for mesh in assembly.meshes}
    found = []
    for face in rounds:
        low, high = _box(triangles[face.number])
        near = ((boxes[:, 0] <= high + REACH) & (boxes[:, 1] >= low - REACH)).all(axis=1)
        for other in (faces[i] for i in np.flatnonzero(near).tolist()):
            if other.part == face.part or frozenset((face.number, other.number)) in joints or _is_first(other, face):
                continue
            pair = nearest_place(face, other, triangles, (sags[face.part], sags[other.part]))
            if pair is None or not -DEEPEST_OVERLAP <= pair.gap <= REACH:
                continue
            profile = _profile(assembly, triangles, face, other, pair.middle)
            if profile is not None or _has_a_primitive(other):
                found.append(_facing(face, other, pair, profile))
    return _one_of_each_profile(sorted(found, key=lambda each: (each.gap, each.faces)))


def _box(corners: Array) -> Array:
    """Return the smallest and largest coordinates of triangles, shape (2, 3)."""
    points = corners.reshape(-1, 3)
    return np.array([points.min(axis=0), points.max(axis=0)])


def _profile(
    assembly: CadAssembly, triangles: dict[int, Array], face: CadFace, other: CadFace, at: Array
) -> ExtrudedProfile | None:
    """Return the profile that continues smoothly beyond the touched face, or is hollow there."""
    if other.kind == "cylinder" and other.span < WHOLE:
        return extruded_profile(assembly, triangles, other, other.axis, at)
    if other.kind == "plane" and face.kind == "cylinder":
        profile = extruded_profile(assembly, triangles, other, face.axis, at)
        return profile if profile is not None and profile.is_smooth_at(other.number) else None
    return None


def _has_a_primitive(other: CadFace) -> bool:
    """Return whether a single face can be written in a mechanism file: by its splines, or as a closed round solid."""
    if other.splines or other.kind in ("plane", "sphere"):
        return True
    if other.kind == "cylinder" and not other.hollow:
        return True
    return other.kind in ("cylinder", "cone") and other.span >= WHOLE


def _one_of_each_profile(found: list[FacingRound]) -> list[FacingRound]:
    """Return the candidates without those that share round face and profile with an earlier one."""
    kept: dict[tuple[int, frozenset[int]], FacingRound] = {}
    for each in found:
        pieces = each.profile.pieces if each.profile else ()
        kept.setdefault((each.faces[1], frozenset(piece.face for piece in pieces) or frozenset(each.faces)), each)
    return list(kept.values())


def _facing(face: CadFace, other: CadFace, pair: NearestPlace, profile: ExtrudedProfile | None) -> FacingRound:
    return FacingRound(
        faces=(other.number, face.number),
        parts=(other.part, face.part),
        gap=pair.gap,
        middle=pair.middle,
        normal=pair.normal,
        stretch=pair.stretch,
        is_estimate=pair.is_estimate,
        profile=profile,
    )


def _is_first(other: CadFace, face: CadFace) -> bool:
    """Return whether the other of two convex faces is the round one of the pair: a ball, a roller, the smaller one."""
    if other.hollow or other.kind not in ("cylinder", "sphere"):
        return False
    return _rank(other) < _rank(face)


def _rank(face: CadFace) -> tuple[bool, bool, float, int]:
    return face.kind != "sphere", face.span < WHOLE, face.radius, face.number
