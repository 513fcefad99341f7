"""Profiles of lines and arcs drawn at random, and their signed distances by brute force.

Nothing is the engine's: an arc's span is found by angles, and what is inside by counting how often a ray leaves.
"""

from itertools import pairwise
from typing import Any

import numpy as np
from pydantic import ValidationError

from engine.mechanism.closed_profiles import Extruded, Turned

Array = np.ndarray
Pieces = list[tuple[Array, Array, Array | None, int]]


def pieces(start: Any, profile: Any) -> Pieces:
    """Return start, end, centre and way (1 left, -1 right) of every piece, with the line that closes the profile."""
    found: Pieces = []
    at = np.array(start, float)
    for segment in profile:
        entry = segment if isinstance(segment, dict) else segment.model_dump()
        centre = None if entry.get("centre") is None else np.array(entry["centre"], float)
        found.append((at, np.array(entry["to"], float), centre, -1 if entry.get("turn") == "right" else 1))
        at = found[-1][1]
    if np.any(at != found[0][0]):
        found.append((at, found[0][0], None, 1))
    return found


def spanned(start: Array, end: Array, centre: Array, way: int) -> tuple[float, float, float]:
    """Return an arc's radius, the angle at which it begins, and the angle that it spans."""
    a, b = start - centre, end - centre
    first, last = np.arctan2(a[1], a[0]), np.arctan2(b[1], b[0])
    return float(np.hypot(*a)), float(first), float((way * (last - first)) % (2 * np.pi)) or 2 * np.pi


def profile_gap(found: Pieces, p: Array, axis: bool) -> Array:
    """Return the signed distance of points (..., 2) from a profile; with ``axis`` pieces on u = 0 are no surface."""
    distance, inside = np.full(p.shape[:-1], np.inf), np.zeros(p.shape[:-1], bool)
    for start, end, centre, way in found:
        ends = np.minimum(np.linalg.norm(p - start, axis=-1), np.linalg.norm(p - end, axis=-1))
        if centre is None:
            along = end - start
            share = np.clip((p - start) @ along / (along @ along), 0, 1)
            near = np.linalg.norm(p - start - share[..., None] * along, axis=-1)
            if not (axis and start[0] == 0 == end[0]):
                distance = np.minimum(distance, near)
            rises = (start[1] <= p[..., 1]) != (end[1] <= p[..., 1])
            with np.errstate(divide="ignore", invalid="ignore"):
                at = start[0] + (p[..., 1] - start[1]) / along[1] * along[0]
            inside ^= rises & (at > p[..., 0])
            continue
        radius, first, span = spanned(start, end, centre, way)
        w = p - centre
        within = (way * (np.arctan2(w[..., 1], w[..., 0]) - first)) % (2 * np.pi) <= span
        rho = np.linalg.norm(w, axis=-1)
        distance = np.minimum(distance, np.where(within, np.abs(rho - radius), ends))
        for side in (-1, 1):
            half = np.sqrt(np.maximum(radius**2 - w[..., 1] ** 2, 0))
            angle = np.arctan2(w[..., 1], side * half)
            hit = (np.abs(w[..., 1]) < radius) & ((way * (angle - first)) % (2 * np.pi) < span)
            inside ^= hit & (side * half > w[..., 0])
    return np.where(inside, -distance, distance)


def solid_gap(side: Any, p: Array) -> Array:
    """Return the signed distance of points of the body's frame, shape (..., 3), from a turned or extruded solid."""
    shape = side.primitive
    found, w, n = pieces(shape.start, shape.profile), p - shape.point, np.array(shape.axis)
    z = w @ n
    if side.kind == "turned":
        rho = np.linalg.norm(np.cross(w, n), axis=-1)
        return profile_gap(found, np.stack([rho, z], axis=-1), axis=True)
    plane = np.stack([w @ np.array(shape.along), w @ np.cross(n, shape.along)], axis=-1)
    d = profile_gap(found, plane, axis=False)
    over = np.abs(z) - (shape.half_length or np.inf)
    return np.where((d > 0) & (over > 0), np.hypot(d, np.maximum(over, -1)), np.maximum(d, over))


def bent(start: Array, end: Array, rng: np.random.Generator) -> dict[str, Any]:
    """Return a line, or as often an arc, from one point to another."""
    segment: dict[str, Any] = {"to": end.tolist()}
    if rng.random() < 0.5:
        along, way = end - start, 1 if rng.random() < 0.6 else -1
        over = rng.uniform(0.2, 2.0) * way * np.array([-along[1], along[0]])
        segment |= {"centre": (0.5 * (start + end) + over).tolist(), "turn": "left" if way > 0 else "right"}
    return segment


def drawn_profile(kind: str, rng: np.random.Generator) -> dict[str, Any]:
    """Draw a profile that does not meet itself: round a point, or of a turned solid as often from axis to axis."""
    while True:
        n = int(rng.integers(3, 8))
        if kind == "turned" and rng.random() < 0.5:
            points = np.stack([rng.uniform(0.3, 1.2, n + 1), np.linspace(-1, 1, n + 1)], axis=1)
            points[[0, -1], 0] = 0.0
        else:
            angles = np.sort(rng.uniform(0, 2 * np.pi, n))
            radii = rng.uniform(0.3, 1.0, n)
            points = np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=1)
            points += [1.3, 0.0] if kind == "turned" else rng.uniform(-0.3, 0.3, 2)
        segments = [bent(a, b, rng) for a, b in pairwise(points)]
        profile = {"start": points[0].tolist(), "profile": segments}
        own = {"point": [0, 0, 0], "axis": [0, 0, 1]} | ({"along": [1, 0, 0]} if kind == "extruded" else {})
        try:
            (Extruded if kind == "extruded" else Turned).model_validate({**own, **profile})
        except ValidationError:
            continue
        return profile
