"""Plane faces of two parts that face each other across a small gap: candidates for stops."""

from dataclasses import dataclass

import numpy as np

from engine.arrays import Array, Integers
from engine.cad.cad_model import CadAssembly, CadFace, Coordinates, Millimetres, SquareMillimetres
from engine.cad.findings.common_area import common_area

REACH = 1.0
"""Largest gap between faces that could form a stop [mm]."""
DEEPEST_OVERLAP = 0.1
"""Largest overlap of such faces as posed [mm]."""
LEAST_AREA = 0.25
"""Smallest area shared by two plane faces [mm2]: anything less is a sliver, where one edge lies over another."""
_PARALLEL = 1e-3  # rad
_LEAST_SHARE = 1e-3  # of the smaller face; less is a corner over an edge


@dataclass(frozen=True, eq=False, kw_only=True)
class FacingPlanes:
    """Two plane faces that overlap at least partly, as seen along their normal."""

    faces: tuple[int, int]
    parts: tuple[str, str]
    gap: Millimetres
    """Distance as posed [mm]; negative where the parts overlap."""
    area: SquareMillimetres
    """Shared area [mm2], with round edges replaced by chords."""
    middle: Coordinates
    """Middle of the shared area, on the first face, shape (3,) [mm]."""
    normal: Array
    """Normal of the first face, towards the second, shape (3,)."""


def facing_planes(assembly: CadAssembly, triangles: dict[int, Array]) -> list[FacingPlanes]:
    """Return the plane faces of different parts that face each other, the smallest gap first.

    The gap is at most 1 mm, and the shared area is at least 0.25 mm2.
    """
    planes = [face for face in assembly.faces if face.kind == "plane" and face.number in triangles]
    found = []
    for i, j in _near(planes, triangles).tolist():
        first, second = planes[i], planes[j]
        area, middle = common_area(triangles[first.number], triangles[second.number], first.axis)
        if area > max(LEAST_AREA, _LEAST_SHARE * min(first.area, second.area)):
            found.append(
                FacingPlanes(
                    faces=(first.number, second.number),
                    parts=(first.part, second.part),
                    gap=float((second.point - first.point) @ first.axis),
                    area=area,
                    middle=middle,
                    normal=first.axis,
                )
            )
    return sorted(found, key=lambda pair: pair.gap)


def _near(planes: list[CadFace], triangles: dict[int, Array]) -> Integers:
    """Return the pairs of planes that may face each other: opposite normals, a small gap, close boxes; (n, 2)."""
    if len(planes) < 2:
        return np.zeros((0, 2), np.int64)
    normals, points = np.array([f.axis for f in planes]), np.array([f.point for f in planes])
    parts = np.unique([f.part for f in planes], return_inverse=True)[1]
    # `<` of the parts: each pair once, and none within a part
    opposite = np.argwhere((normals @ normals.T < -np.cos(_PARALLEL)) & (parts[:, None] < parts))
    gaps = np.einsum("nk,nk->n", points[opposite[:, 1]] - points[opposite[:, 0]], normals[opposite[:, 0]])
    opposite = opposite[(gaps <= REACH) & (gaps >= -DEEPEST_OVERLAP)]
    corners = [triangles[f.number].reshape(-1, 3) for f in planes]
    lows = np.array([each.min(axis=0) for each in corners]) - REACH
    highs = np.array([each.max(axis=0) for each in corners]) + REACH
    i, j = opposite.T
    near: Integers = opposite[((lows[i] <= highs[j]) & (lows[j] <= highs[i])).all(axis=1)]
    return near
