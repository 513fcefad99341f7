"""Convex polyhedra as corners, plane faces of any number of corners, and the edges between these."""

from collections import defaultdict
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from engine.arrays import Array, Integers

FLAT = 3e-7  # share of the size: corners no farther from a plane lie in it; the numbers of an STL file are that exact
FACING = 0.9  # cosine of the largest angle between triangles that can be one face


class NotSolid(ValueError):
    """Points span no polyhedron: they lie in one plane, on one line, or there are fewer than four."""


@dataclass(frozen=True, eq=False)
class Polyhedron:
    """A convex polyhedron, or what else has a hull: a point, a line, a half-space."""

    corners: Array  # (nv, 3)
    faces: Array  # (nf, 4) normals out of it, and their products with the points of the faces
    rings: tuple[tuple[int, ...], ...]  # the corners around each face, counterclockwise seen from outside
    edges: Integers  # (ne, 4) two corners, two faces

    @property
    def triangles(self) -> Array:
        """The corners of triangles that are its surface, (n, 3, 3)."""
        fans = [(ring[0], *pair) for ring in self.rings for pair in pairwise(ring[1:])]
        return np.asarray(self.corners[np.array(fans)])


def hull_of(points: Array) -> Polyhedron:
    """Return the convex hull of points, (n, 3); raise NotSolid if it has no volume."""
    from scipy.spatial import ConvexHull, QhullError  # 0.1 s to load

    size = float(np.ptp(points, axis=0).max(initial=0.0))
    middle = points.mean(axis=0) if len(points) else 0.0
    if len(points) < 4 or np.linalg.matrix_rank(points - middle, FLAT * size * np.sqrt(len(points))) < 3:
        raise NotSolid
    try:
        found = ConvexHull(points)
    except QhullError:
        raise NotSolid from None
    used = np.sort(found.vertices)
    corners = points[used]
    triangles = np.searchsorted(used, found.simplices)
    p, q, r = corners[triangles].transpose(1, 0, 2)
    normals = np.cross(q - p, r - p)
    inwards = np.einsum("ij,ij->i", normals, found.equations[:, :3]) < 0.0
    triangles[inwards] = triangles[inwards][:, ::-1]
    areas = np.linalg.norm(normals, axis=1)
    normals = found.equations[:, :3]
    return _with_faces(corners, triangles, normals, (found.neighbors, areas, FLAT * size))


def _with_faces(
    corners: Array, triangles: Integers, normals: Array, grown: tuple[Integers, Array, float]
) -> Polyhedron:
    """Return a polyhedron from triangles; those in one plane become one face, beginning from the largest."""
    neighbours, areas, slack = grown
    face_of = np.full(len(triangles), -1)
    faces: list[list[float]] = []
    rings: list[tuple[int, ...]] = []
    for seed in np.argsort(-areas, kind="stable"):
        if face_of[seed] >= 0:
            continue
        n, number = normals[seed], len(faces)
        height = corners @ n
        flat = (np.abs(height[triangles] - height[triangles[seed]].mean()) <= slack).all(axis=1)
        flat &= (normals @ n >= FACING) & (face_of < 0)
        members, todo = {int(seed)}, [int(seed)]
        while todo:
            for other in map(int, neighbours[todo.pop()]):
                if flat[other] and other not in members:
                    members.add(other)
                    todo.append(other)
        own = sorted(members)
        face_of[own] = number
        faces.append([*n, height.max()])
        rings.append(_ring(triangles[own]))
    sides = {pair: face for face, ring in enumerate(rings) for pair in zip(ring, ring[1:] + ring[:1], strict=True)}
    edges = [(i, j, face, sides[j, i]) for (i, j), face in sides.items() if i < j and (j, i) in sides]
    return Polyhedron(corners, np.array(faces), tuple(rings), np.array(edges, np.int64).reshape(-1, 4))


def _ring(triangles: Integers) -> tuple[int, ...]:
    """Return the corners around triangles in one plane, in order: the longest closed way along their outer sides."""
    sides = {(int(t[k]), int(t[(k + 1) % 3])) for t in triangles for k in range(3)}
    after: dict[int, list[int]] = defaultdict(list)
    for i, j in sorted(sides):
        if (j, i) not in sides:
            after[i].append(j)
    start = min(after)
    ring = [start]
    while (following := after[ring[-1]].pop()) != start:
        ring.append(following)
    return tuple(ring)
