"""How far the surface of convex pieces is from that of their mesh, both ways: bounds that hold, up to rounding.

From the mesh to the pieces: a triangle of the mesh is no deeper in its piece than below any one of its faces, where it
leaves the pieces if no other one is between; else no deeper than where it leaves them all. From the pieces to the mesh:
the distance from a triangle is convex, so on a polygon it is largest at a corner. Where a face of a piece is made up of
triangles of the mesh it is 0; where it lies in another piece it is no surface. All else is divided, the worst first.
"""

import heapq
from collections.abc import Iterator, Sequence

import numpy as np

from engine.arrays import Array
from engine.mechanism.meshes.decomposition import Piece, clipped
from engine.mechanism.meshes.polyhedra import FACING, FLAT, Polyhedron

CLOSE = 0.02  # share by which a bound may exceed the largest distance that was found
MOST_PARTS = 4000  # into which faces are divided
HALVINGS = 4  # of triangles that another piece may hide
ROUNDING = 10.0  # times what numbers of an STL file are exact to, added to each bound for all that is compared with it
CANDIDATES = 64  # triangles of the mesh that are examined for each part


def largest_deviation(points: Array, pieces: Sequence[Piece]) -> tuple[float, float]:
    """Return bounds of the distances of a mesh, (n, 3, 3), from the surface of its pieces, and of this from it."""
    slack = FLAT * max(float(np.ptp(points.reshape(-1, 3), axis=0).max()), float(np.abs(points).max()))
    hulls = [piece.hull for piece in pieces]
    deepest = max(_from_mesh(k, piece.surface, hulls, slack) for k, piece in enumerate(pieces))
    return deepest + ROUNDING * slack, _from_pieces(points, pieces, hulls, slack) + ROUNDING * slack


# From the mesh to the pieces.


def _from_mesh(number: int, surface: Array, hulls: list[Polyhedron], slack: float) -> float:
    """Return the bound of the distance of a piece's part of the mesh from the surface of all pieces."""
    own, largest = hulls[number], 0.0
    others = [hull for k, hull in enumerate(hulls) if k != number and _beside(own, hull, slack)]
    for halving in range(HALVINGS + 1):
        over = surface @ own.faces[:, :3].T - own.faces[:, 3]  # (n, 3, faces)
        depth = np.maximum(-over.min(axis=1), 0.0)
        outside = np.where(over.max(axis=(1, 2)) > slack, _distances(surface, own), 0.0)
        bound = np.full(len(surface), np.inf)
        for face in np.argsort(depth, axis=1)[:, :4].T:
            n = own.faces[face]
            there = surface - np.einsum("ijk,ik->ij", surface, n[:, :3])[..., None] * n[:, None, :3]
            there += (n[:, 3, None] * n[:, :3])[:, None]
            swept = np.concatenate([surface, there], axis=1)
            free = np.ones(len(surface), bool)
            for other in others:
                free &= ((swept @ other.faces[:, :3].T - other.faces[:, 3]).min(axis=1) >= -slack).any(axis=1)
            bound = np.where(free, np.minimum(bound, depth[np.arange(len(surface)), face]), bound)
        if halving == HALVINGS:
            support = np.max([(hull.corners @ own.faces[:, :3].T).max(axis=0) for hull in hulls], axis=0)
            leaving = (support - (surface @ own.faces[:, :3].T).min(axis=1)).min(axis=1)
            bound = np.minimum(bound, leaving)
        hidden = np.isinf(bound)
        largest = max(largest, float(np.max(np.maximum(bound, outside)[~hidden], initial=0.0)))
        if not hidden.any():
            break
        surface = _quartered(surface[hidden])
    return largest


def _beside(one: Polyhedron, other: Polyhedron, slack: float) -> bool:
    """Return whether the boxes around two hulls meet."""
    low, high = other.corners.min(axis=0) - slack, other.corners.max(axis=0) + slack
    return bool((one.corners.max(axis=0) >= low).all() and (one.corners.min(axis=0) <= high).all())


def _quartered(triangles: Array) -> Array:
    """Return the four quarters of each triangle."""
    p, q, r = triangles.transpose(1, 0, 2)
    a, b, c = 0.5 * (p + q), 0.5 * (q + r), 0.5 * (r + p)
    parts = [(p, a, c), (a, q, b), (c, b, r), (a, b, c)]
    return np.concatenate([np.stack(part, axis=1) for part in parts])


def _distances(surface: Array, hull: Polyhedron) -> Array:
    """Return the largest distance of the corners of each triangle from a hull, (n,); 0 inside."""
    points = surface.reshape(-1, 3)
    over = (points @ hull.faces[:, :3].T - hull.faces[:, 3]).max(axis=1)
    found = np.zeros(len(points))
    for k in np.flatnonzero(over > 0.0):
        found[k] = distances_from(points[k], hull.triangles).min()
    return np.asarray(found.reshape(-1, 3).max(axis=1))


def distances_from(point: Array, triangles: Array) -> Array:
    """Return the distances of a point from triangles, (n, 3, 3); one without area is the line of its corners."""
    p, q, r = triangles.transpose(1, 0, 2)
    n = np.cross(q - p, r - p)
    length = np.linalg.norm(n, axis=1)
    found = np.full(len(triangles), np.inf)
    inside = length > 0.0
    for a, b in ((p, q), (q, r), (r, p)):
        edge, w = b - a, point - a
        square = np.einsum("ij,ij->i", edge, edge)
        share = np.clip(np.einsum("ij,ij->i", w, edge) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
        found = np.minimum(found, np.linalg.norm(w - share[:, None] * edge, axis=1))
        inside &= np.einsum("ij,ij->i", np.cross(edge, w), n) >= 0.0
    height = np.abs(np.einsum("ij,ij->i", point - p, n)) / np.where(length > 0.0, length, 1.0)
    return np.where(inside, height, found)


# From the pieces to the mesh.


def _from_pieces(points: Array, pieces: Sequence[Piece], hulls: list[Polyhedron], slack: float) -> float:
    """Return the bound of the distance of the surface of all pieces from the mesh."""
    low, high = points.min(axis=1), points.max(axis=1)

    def measured(polygon: Array) -> tuple[float, float, Array]:
        """Return bounds of the largest distance of a polygon from the mesh, and the triangle nearest to its middle."""
        middle = polygon.mean(axis=0)
        apart = np.linalg.norm(np.maximum(np.maximum(low - middle, middle - high), 0.0), axis=1)
        size = float(np.linalg.norm(polygon - middle, axis=1).max())
        count = min(CANDIDATES, len(points))
        near = np.argpartition(apart, count - 1)[:count] if count < len(points) else np.arange(len(points))
        triangles = points[near]
        to_middle = distances_from(middle, triangles)
        to_corners = np.array([distances_from(corner, triangles) for corner in polygon])
        upper = float(to_corners.max(axis=0).min())
        known = float(apart[near].max()) if count < len(points) else np.inf  # others are no nearer to the middle
        lower = max(min(float(to_middle.min()), known), float(min(to_corners.min(axis=1).max(), known - size)))
        return upper, lower, triangles[int(to_middle.argmin())]

    heap: list[tuple[float, int, Array, Array]] = []
    largest, count = 0.0, 0
    for number, piece in enumerate(pieces):
        for face, ring in enumerate(piece.hull.rings):
            polygon = piece.hull.corners[list(ring)]
            if _made_up(piece, face, slack):
                continue
            for part in _bare(polygon, piece.hull.faces[face], [h for k, h in enumerate(hulls) if k != number], slack):
                upper, lower, nearest = measured(part)
                largest, count = max(largest, lower), count + 1
                heapq.heappush(heap, (-upper, count, part, nearest))
    while heap and -heap[0][0] > max((1.0 + CLOSE) * largest, largest + slack) and count < MOST_PARTS:
        upper, _, polygon, nearest = heapq.heappop(heap)
        for part in _divided(polygon, nearest, slack):
            top, lower, nearest_to_part = measured(part)
            largest, count = max(largest, lower), count + 1
            heapq.heappush(heap, (-min(top, -upper), count, part, nearest_to_part))
    return -heap[0][0] if heap else 0.0


def _made_up(piece: Piece, face: int, slack: float) -> bool:
    """Return whether a face is made up of triangles of the mesh: all their free sides lie on its boundary.

    How often triangles with one normal cover a place changes at their free sides only, so it is the same everywhere.
    """
    n, ring = piece.hull.faces[face], piece.hull.corners[list(piece.hull.rings[face])]
    p, q, r = piece.surface.transpose(1, 0, 2)
    lying = (np.abs(piece.surface @ n[:3] - n[3]) <= 2.0 * slack).all(axis=1)
    normals = np.cross(q - p, r - p)
    lying &= normals @ n[:3] > FACING * np.linalg.norm(normals, axis=1)
    if not lying.any():
        return False
    names = np.round(piece.surface[lying] / (4.0 * slack)).astype(np.int64)
    sides = {}
    for triangle, name in zip(piece.surface[lying], map(tuple, names.tolist()), strict=True):
        corners = [tuple(corner) for corner in name]
        for k in range(3):
            sides[corners[k - 1], corners[k]] = triangle[k - 1], triangle[k]
    free = [ends for (i, j), ends in sides.items() if (j, i) not in sides and i != j]
    edges = np.roll(ring, -1, axis=0) - ring
    length = np.linalg.norm(edges, axis=1)
    for ends in free:
        w = np.array(ends)[:, None] - ring
        along = np.einsum("ikj,kj->ik", w, edges) / length
        off = np.linalg.norm(w - (along / length)[..., None] * edges, axis=2)
        if not (off.max(axis=0) <= 8.0 * slack).any():
            return False
    return True


def _bare(polygon: Array, face: Array, hulls: list[Polyhedron], slack: float) -> list[Array]:
    """Return the parts of a face that no other piece covers; one with the same face does not."""
    parts = [polygon]
    for hull in hulls:
        over = polygon @ hull.faces[:, :3].T - hull.faces[:, 3]
        same = (np.abs(over).max(axis=0) <= 10.0 * slack) & (hull.faces[:, :3] @ face[:3] > 1.0 - 1e-6)
        if same.any() or ((over.min(axis=0) >= -slack).any() and not (np.abs(over).max(axis=0) <= slack).any()):
            continue
        left: list[Array] = []
        for part in parts:
            left += _outside(part, hull, slack)
        parts = left
    return parts


def _outside(polygon: Array, hull: Polyhedron, slack: float) -> Iterator[Array]:
    """Yield the parts of a polygon outside a hull."""
    for n in hull.faces:
        side = polygon @ n[:3] - n[3]
        side[np.abs(side) <= slack] = 0.0
        if (side > 0.0).any():
            yield clipped(polygon, -side)
            polygon = clipped(polygon, side)
            if len(polygon) < 3 or (side >= 0.0).all():
                return


def _divided(polygon: Array, triangle: Array, slack: float) -> list[Array]:
    """Return the parts of a polygon over a triangle and beside it; if that is all or nothing, two halves."""
    p, q, r = triangle
    n, parts, inside = np.cross(q - p, r - p), [], polygon
    for a, b in ((p, q), (q, r), (r, p)):
        out = np.cross(b - a, n)
        length = float(np.linalg.norm(out))
        if length == 0.0:
            continue
        side = (inside - a) @ out / length
        side[np.abs(side) <= slack] = 0.0
        if (side > 0.0).any() and (side < 0.0).any():
            parts.append(clipped(inside, -side))
            inside = clipped(inside, side)
        elif (side >= 0.0).all():  # beside the triangle
            parts, inside = [], polygon
            break
    if parts:
        return [*parts, inside]
    middle = polygon.mean(axis=0)
    way = np.linalg.svd(polygon - middle)[2][0]
    side = (polygon - middle) @ way
    return [clipped(polygon, side), clipped(polygon, -side)]
