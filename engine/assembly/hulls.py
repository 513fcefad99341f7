"""Convex polyhedra of contacts, and their pairs as arrays (`kernels.model.Hulls`)."""

import math
from collections.abc import Sequence
from itertools import product

import numpy as np

from engine.arrays import Array
from engine.assembly.frames import BodyFrame
from engine.kernels.contact_geometry.hulls import FOUND
from engine.kernels.model import Hulls
from engine.mechanism.contacts import Side
from engine.mechanism.meshes.polyhedra import Polyhedron, hull_of

NOTHING = np.zeros((0, 4), np.int64)


def hulls_of(side: Side, frame: BodyFrame) -> list[Polyhedron]:
    """Return the convex polyhedra of a side from its body's centre of mass, without its skin."""
    shape = side.primitive
    if side.kind == "mesh":
        return [hull_of(_placed(piece.numbers, frame)) for piece in shape.pieces]
    if side.kind == "plane":
        n = frame.direction(shape.normal)
        return [Polyhedron(np.zeros((0, 3)), np.array([[*n, n @ frame.point(shape.point)]]), ((),), NOTHING)]
    if side.kind == "box":
        along, normal = np.array(shape.along), np.array(shape.normal)
        arms = np.array([along, np.cross(normal, along), normal]) * np.array(shape.half_lengths)[:, None]
        corners = shape.centre + np.array(list(product((-1.0, 1.0), repeat=3))) @ arms
        return [hull_of(_placed(corners, frame))]
    if side.kind == "capsule":
        arm = shape.half_length * np.array(shape.axis)
        ends = _placed(np.array([shape.point - arm, shape.point + arm]), frame)
        return [Polyhedron(ends, np.zeros((0, 4)), (), np.array([[0, 1, -1, -1]]))]
    point = shape if side.kind == "point" else shape.centre
    return [Polyhedron(_placed(np.array([point]), frame), np.zeros((0, 4)), (), NOTHING)]


def skin_of(side: Side, frame: BodyFrame) -> float:
    """Return how far a side extends beyond its polyhedra."""
    return frame.scale * float(side.primitive.radius) if side.kind in ("sphere", "capsule") else 0.0


def ball_around(hull: Polyhedron) -> tuple[Array, float]:
    """Return the middle of a polyhedron's corners, and the distance of the farthest one; of a half-space 0."""
    if not len(hull.corners):
        return np.zeros(3), 0.0
    middle = 0.5 * (hull.corners.min(axis=0) + hull.corners.max(axis=0))
    return middle, float(np.linalg.norm(hull.corners - middle, axis=1).max())


def _placed(points: Array, frame: BodyFrame) -> Array:
    """Return points of a body, (n, 3), from its centre of mass."""
    return np.asarray(frame.origin + (frame.scale * points) @ frame.rotation.T)


def hull_arrays(pairs: Sequence[tuple[Polyhedron, Polyhedron] | None]) -> Hulls | None:
    """Return the polyhedra of contacts as arrays; None if no contact has any. Equal objects are included once."""
    own = list({id(hull): hull for pair in pairs if pair for hull in pair}.values())
    if not own:
        return None
    number = {id(hull): k for k, hull in enumerate(own)}
    rows = {key: k for k, key in enumerate(dict.fromkeys((id(p[0]), id(p[1])) for p in pairs if p))}
    counts = np.array([(len(h.corners), len(h.faces), len(h.edges)) for h in own])
    ends = np.cumsum(counts, axis=0)
    rings = [ring for hull in own for ring in hull.rings]
    lengths = np.array([len(ring) for ring in rings], np.int64)
    after = np.cumsum(lengths)
    found = np.full((len(rows), FOUND), math.nan)
    return Hulls(
        span=np.stack([ends - counts, ends], axis=2).reshape(-1, 6).astype(np.int64),
        vertex=np.concatenate([hull.corners for hull in own]),
        face=np.concatenate([hull.faces for hull in own]),
        ring=np.stack([after - lengths, after], axis=1).astype(np.int64),
        corner=np.array([corner for ring in rings for corner in ring], np.int64),
        edge=np.concatenate([hull.edges for hull in own]),
        of=np.array([(number[id(p[0])], number[id(p[1])]) if p else (-1, -1) for p in pairs], np.int64),
        pair=np.array([rows[id(p[0]), id(p[1])] if p else -1 for p in pairs], np.int64),
        found=found,
        placed=np.zeros((int(counts[:, 0].max()), 3)),
        placed_face=np.zeros((int(counts[:, 1].max()), 4)),
        polygon=np.zeros((2, 2 * int(max(2, *lengths, 2)) + 4, 3)),
    )
