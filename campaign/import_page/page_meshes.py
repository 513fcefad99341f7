"""Triangle meshes of parts for a page, with few enough triangles for a browser, and sorted by face."""

from bisect import bisect_left
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from engine.arrays import Array, Integers
from engine.cad.cad_model import TriangleMesh

MOST_TRIANGLES = 250_000
"""Limit for all parts together; beyond it the parts are drawn coarser. A page of this many has about 8 MB."""

_FINEST, _WIDER = 4000, 1.25  # cells along the longest side in the finest grid; width ratio of successive grids
_STEPS = 40  # number of grids; in the last one a part is in one cell, and no triangle is left


@dataclass(frozen=True, eq=False)
class PageMesh:
    """The triangle mesh of a part."""

    vertices: NDArray[np.float32]  # relative to the page's centre, (n, 3)
    triangles: NDArray[np.uint32]  # rows of `vertices`, counter-clockwise seen from outside, sorted by face, (m, 3)
    stretches: dict[int, tuple[int, int]]  # first triangle and number of triangles of each face, by its number


def page_meshes(meshes: Iterable[TriangleMesh], centre: Array, most: int) -> tuple[list[PageMesh], float]:
    """Return the meshes of parts for a page, and their largest distance from the faces.

    If there are more than `most` triangles, the vertices in each cell of a grid are merged into their mean, with the
    finest grid that leaves few enough triangles. The origin of the page, `centre` (3,), should be near the parts, where
    single precision is most accurate.
    """
    meshes = list(meshes)
    drawn, moved = meshes, 0.0
    if _count(meshes) > most:
        finest = max(float(np.ptp(mesh.vertices, axis=0).max()) for mesh in meshes if len(mesh.vertices)) / _FINEST
        cells = finest * _WIDER ** np.arange(_STEPS)
        enough = bisect_left(cells, True, key=lambda cell: _count(coarser(mesh, cell)[0] for mesh in meshes) <= most)
        made = [coarser(mesh, cells[enough]) for mesh in meshes]
        drawn, moved = [mesh for mesh, _ in made], max(each for _, each in made)
    deflection = max((mesh.deflection for mesh in meshes), default=0.0)
    return [_of_page(mesh, centre) for mesh in drawn], deflection + moved


def coarser(mesh: TriangleMesh, cell: float) -> tuple[TriangleMesh, float]:
    """Return a mesh whose vertices in each cell of a grid are merged, and the largest displacement of a vertex.

    Triangles that collapse are left out; `cell` is the side length of a cell, > 0.
    """
    if not len(mesh.triangles):
        return mesh, 0.0
    grid = np.floor((mesh.vertices - mesh.vertices.min(axis=0)) / cell).astype(np.int64)
    place = _numbered(np.ravel_multi_index(tuple(grid.T), tuple(grid.max(axis=0) + 1)))
    sums = [np.bincount(place, coordinate) for coordinate in mesh.vertices.T]
    middles = np.stack(sums, axis=1) / np.bincount(place)[:, None]
    faces = np.zeros(len(mesh.vertices), np.int64)
    faces[mesh.triangles] = mesh.faces[:, None]
    # Vertices are kept per face, so that edges between faces stay sharp, but coincide with those of neighbouring faces.
    vertex = _numbered(place * (faces.max() + 1) + faces)
    vertices = np.zeros((vertex.max() + 1, 3))
    vertices[vertex] = middles[place]
    places = place[mesh.triangles]
    kept = (places != np.roll(places, 1, axis=1)).all(axis=1)
    less = replace(mesh, vertices=vertices, triangles=vertex[mesh.triangles[kept]], faces=mesh.faces[kept])
    return less, float(np.linalg.norm(middles[place] - mesh.vertices, axis=1).max())


def _count(meshes: Iterable[TriangleMesh]) -> int:
    """Return the total number of triangles."""
    return sum(len(mesh.triangles) for mesh in meshes)


def _numbered(keys: Integers) -> Integers:
    """Return the rank of each key among the distinct keys."""
    return np.asarray(np.unique(keys, return_inverse=True)[1].ravel(), np.int64)


def _of_page(mesh: TriangleMesh, centre: Array) -> PageMesh:
    """Return a mesh in single precision, sorted by face, without unused vertices."""
    order = np.argsort(mesh.faces, kind="stable")
    used, triangles = np.unique(mesh.triangles[order], return_inverse=True)
    numbers, firsts, counts = np.unique(mesh.faces[order], return_index=True, return_counts=True)
    return PageMesh(
        vertices=(mesh.vertices[used] - centre).astype(np.float32),
        triangles=triangles.reshape(-1, 3).astype(np.uint32),
        stretches=_stretches(numbers, firsts, counts),
    )


def _stretches(numbers: Integers, firsts: Integers, counts: Integers) -> dict[int, tuple[int, int]]:
    rows = zip(numbers.tolist(), firsts.tolist(), counts.tolist(), strict=True)
    return {number: (first, count) for number, first, count in rows}
