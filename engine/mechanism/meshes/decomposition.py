"""A mesh as convex pieces: the hull of each closed surface, cut by planes where it is hollow, until all is convex.

The hull of a part of a solid is that of the part of its surface, because what a cut opens lies between points of both.
So triangles are cut, and no cut is closed. Of the planes through hollow places, the one is taken after which both hulls
are smallest: for flat faces that meet at right angles this leads to a partition without any rest.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from engine.arrays import Array
from engine.mechanism.meshes.mesh import MOST_CORNERS, MOST_PIECES
from engine.mechanism.meshes.polyhedra import FLAT, NotSolid, Polyhedron, hull_of
from engine.mechanism.meshes.stl import TriangleMesh

PLANES = 24  # that are tried for each cut
SPREAD = 200  # directions in which corners are chosen first, of a piece that has too many
PARALLEL = 1e-6  # difference of normals that are one


@dataclass(frozen=True, eq=False)
class Piece:
    """A part of a mesh's surface, and its hull."""

    surface: Array  # (n, 3, 3) triangles
    hull: Polyhedron

    @cached_property
    def depths(self) -> Array:
        """How deep the middle of each triangle lies in the hull; no point of it lies three times as deep."""
        middles, faces = self.surface.mean(axis=1), self.hull.faces
        return np.asarray(np.min(faces[:, 3] - middles @ faces[:, :3].T, axis=1))


def convex_pieces(mesh: TriangleMesh, enough: float) -> list[Piece]:
    """Return the pieces of a mesh: as many as leave no surface deeper in its hull than ``enough``, up to MOST_PIECES.

    Each piece has at most MOST_CORNERS corners; if its hull has more, those are left out that change it least.
    """
    done: list[Piece] = []
    rest = [piece for shell in range(int(mesh.shell.max()) + 1) if (piece := _piece(mesh.points[mesh.shell == shell]))]
    while rest:
        rest.sort(key=lambda piece: piece.depths.max())
        worst = rest.pop()
        hollow = 3.0 * worst.depths.max() > enough
        halves = _cut(worst, FLAT * mesh.size) if hollow and len(done) + len(rest) + 1 < MOST_PIECES else None
        if halves is None:
            done.append(worst)
        else:
            rest += halves
    return [Piece(piece.surface, _simplified(piece.hull)) for piece in done]


def _piece(surface: Array) -> Piece | None:
    """Return the piece of a surface; None if it has no volume."""
    try:
        return Piece(surface, hull_of(surface.reshape(-1, 3)))
    except NotSolid:
        return None


def _cut(piece: Piece, slack: float) -> tuple[Piece, Piece] | None:
    """Return both sides of a piece by the best of some planes; None if no plane leaves two solids."""
    best, least = None, np.inf
    for n, height in _planes(piece):
        halves = _piece(_below(piece.surface, n, height, slack)), _piece(_below(piece.surface, -n, -height, slack))
        if halves[0] and halves[1]:
            volume = sum(_volume(half.hull) for half in halves if half)
            if volume < least * (1.0 - PARALLEL):
                best, least = (halves[0], halves[1]), volume
    return best


def _volume(hull: Polyhedron) -> float:
    triangles = hull.triangles
    return float(np.einsum("ij,ij->i", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])).sum() / 6.0)


def _planes(piece: Piece) -> list[tuple[Array, float]]:
    """Return planes to cut along: of the hollow triangles, the largest planes first, and across the deepest place."""
    p, q, r = piece.surface.transpose(1, 0, 2)
    products = np.cross(q - p, r - p)
    areas = np.linalg.norm(products, axis=1)
    depths = piece.depths
    hollow = np.flatnonzero((depths > 1e-3 * depths.max()) & (areas > 0.0))
    normals = products[hollow] / areas[hollow, None]
    heights = np.einsum("ij,ij->i", normals, p[hollow])
    weights = areas[hollow] * depths[hollow]
    found: list[tuple[Array, float]] = []
    scale = float(np.ptp(piece.surface.reshape(-1, 3), axis=0).max())
    taken = np.zeros(len(hollow), bool)
    while not taken.all() and len(found) < PLANES:
        left = np.flatnonzero(~taken)
        k = left[weights[left].argmax()]
        alike = np.linalg.norm(normals - normals[k], axis=1) <= 1e-3
        alike &= np.abs(heights - heights[k]) <= 1e-3 * scale
        taken |= alike
        found.append((normals[k], float(heights[k])))
    deepest = piece.surface[depths.argmax()].mean(axis=0)
    return found + [(axis, float(axis @ deepest)) for axis in np.eye(3)]


def _below(surface: Array, n: Array, height: float, slack: float) -> Array:
    """Return the parts of triangles below a plane, and of those in it the ones that bound the solid there."""
    over = surface @ n - height
    over[np.abs(over) <= slack] = 0.0
    whole = (over <= 0.0).all(axis=1)
    lying = (over == 0.0).all(axis=1)
    p, q, r = surface.transpose(1, 0, 2)
    whole &= ~lying | (np.cross(q - p, r - p) @ n > 0.0)
    parts = [surface[whole]]
    for triangle, side in zip(surface[~whole & ~lying], over[~whole & ~lying], strict=True):
        if (side < 0.0).any():
            polygon = clipped(triangle, side)
            parts.append(np.array([[polygon[0], *pair] for pair in pairwise(polygon[1:])]))
    return np.concatenate(parts)


def clipped(polygon: Array, side: Array) -> Array:
    """Return the part of a convex polygon, (n, 3), where a linear function, given at its corners, is at most 0."""
    corners = []
    for k, (p, here) in enumerate(zip(polygon, side, strict=True)):
        q, there = polygon[k - 1], side[k - 1]
        if here * there < 0.0:
            corners.append(q + there / (there - here) * (p - q))
        if here <= 0.0:
            corners.append(p)
    return np.array(corners).reshape(-1, 3)


def _simplified(hull: Polyhedron) -> Polyhedron:
    """Return a hull of at most MOST_CORNERS of its corners."""
    if len(hull.corners) <= MOST_CORNERS:
        return hull
    k = np.arange(SPREAD) + 0.5
    z, turn = 1.0 - 2.0 * k / SPREAD, np.pi * (1.0 + np.sqrt(5.0)) * k
    ways = np.stack([np.sqrt(1.0 - z * z) * np.cos(turn), np.sqrt(1.0 - z * z) * np.sin(turn), z], axis=1)
    chosen = list(dict.fromkeys((hull.corners @ ways.T).argmax(axis=0).tolist()))[: MOST_CORNERS // 2]
    while len(chosen) < MOST_CORNERS:
        smaller = hull_of(hull.corners[chosen])
        outside = (hull.corners @ smaller.faces[:, :3].T - smaller.faces[:, 3]).max(axis=1)
        chosen.append(int(outside.argmax()))
    return hull_of(hull.corners[chosen])
