"""Contact primitives drawn at random, and their signed distances by brute force, many poses at once.

Nothing of the distances is the engine's: a solid is the list of its faces, the distance to it the least of those to the
faces, and an arc is a fine grid of angles with a ternary search around its best ones.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from engine.assembly.contacts import KINDS, Pair, contact_arrays, profile_pieces, rows
from engine.assembly.frames import BodyFrame
from engine.assembly.surface_trees import surface_tree
from engine.kernels.contact_geometry.gaps import find_contacts
from engine.kernels.model import Contacts
from engine.mechanism.contacts import Contact
from tests.engine.kernels.profile_shapes import drawn_profile, solid_gap
from tests.engine.kernels.surface_shapes import graded_rectangle

Array = np.ndarray
GRID = 241
OWN = BodyFrame(0, np.zeros(3), np.eye(3), np.array([1.0, 0, 0, 0]))


def unit(v: Any) -> Array:
    """Return the direction of v."""
    return np.asarray(v) / np.linalg.norm(v)


def across(n: Array, rng: np.random.Generator) -> Array:
    """Return a random unit vector across n."""
    return unit(np.cross(n, rng.normal(size=3)))


def drawn_first(kind: str, rng: np.random.Generator) -> dict[str, Any]:
    """Draw a side a, near the origin of its body."""
    p, n = (0.3 * rng.normal(size=3)).tolist(), unit(rng.normal(size=3))
    if kind == "point":
        return {"point": p}
    if kind in ("sphere", "ring"):
        return {kind: {"centre": p, "radius": float(rng.uniform(0.1, 0.5))}}
    if kind == "cylinder":
        return {"cylinder": {"point": p, "axis": n.tolist(), "radius": float(rng.uniform(0.3, 1.5))}}
    arc = {"centre": p, "normal": n.tolist(), "radius": float(rng.uniform(0.2, 1.8))}
    if rng.random() < 0.7:
        arc |= {"middle": across(n, rng).tolist(), "half_angle": float(rng.uniform(0.2, 3.0))}
    if rng.random() < 0.5:
        arc["edge_radius"] = float(rng.uniform(0.01, 0.2))
    return {"arc": arc}


def drawn_second(kind: str, rng: np.random.Generator) -> dict[str, Any]:
    """Draw a side b, near the origin of its body; half of what may have ends has them."""
    p, n = (0.3 * rng.normal(size=3)).tolist(), unit(rng.normal(size=3))
    size = float(rng.uniform(0.6, 1.6))
    if kind in ("sphere", "socket"):
        return {kind: {"centre": p, "radius": size}}
    if kind in ("cylinder", "bore"):
        ends = {"half_length": float(rng.uniform(0.3, 1.5))} if rng.random() < 0.5 else {}
        return {kind: {"point": p, "axis": n.tolist(), "radius": size, **ends}}
    if kind == "capsule":
        return {kind: {"point": p, "axis": n.tolist(), "radius": size, "half_length": float(rng.uniform(0.3, 1.5))}}
    if kind == "box":
        box = {"centre": p, "normal": n.tolist(), "along": across(n, rng).tolist()}
        return {kind: {**box, "half_lengths": [size, *rng.uniform(0.3, 1.6, 2).tolist()]}}
    if kind == "plane":
        return {"plane": {"point": p, "normal": n.tolist()}}
    if kind == "turned":
        return {kind: {"point": p, "axis": n.tolist(), **drawn_profile(kind, rng)}}
    if kind == "extruded":
        ends = {"half_length": float(rng.uniform(0.3, 1.0))} if rng.random() < 0.7 else {}
        return {
            kind: {"point": p, "axis": n.tolist(), "along": across(n, rng).tolist(), **ends} | drawn_profile(kind, rng)
        }
    if kind == "surface":
        e, sides = across(n, rng), rng.uniform(0.3, 1.6, 2)
        patches = graded_rectangle(*sides) @ np.array([e, np.cross(n, e), n]) + p
        return {kind: {"patches": patches.tolist(), "depth": float(rng.uniform(0.2, 1.0))}}
    depth = {"depth": float(rng.uniform(0.2, 1.0))} if rng.random() < 0.5 else {}
    face = {"centre": p, "normal": n.tolist(), **depth}
    if kind == "disc":
        return {"disc": {**face, "radius": size}}
    sides = [size, float(rng.uniform(0.3, 1.6))]
    return {"rectangle": {**face, "along": across(n, rng).tolist(), "half_lengths": sides}}


def drawn(pair: str, rng: np.random.Generator) -> Contact:
    """Draw a contact of a pair of primitives."""
    first, second = pair.split("-")
    a, b = {"body": "a", **drawn_first(first, rng)}, {"body": "b", **drawn_second(second, rng)}
    if pair in ("ring-cylinder", "ring-bore", "sphere-bore", "sphere-socket"):
        a[first]["radius"] = b[second]["radius"] * (1.2 if pair == "ring-cylinder" else 0.8)
    if pair == "ring-cylinder":
        b[second].pop("half_length", None)
    return Contact.model_validate({"a": a, "b": b, "friction": 0.1, "offset": float(rng.uniform(0, 0.05))})


# ---------------------------------------------------------------------------------------------------------------------
# brute force


def segment(x: Array, low: float, high: float) -> Array:
    """Return the distance of numbers from an interval."""
    return np.maximum(np.maximum(low - x, x - high), 0)


def round_distance(rho: Array, z: Array, inner: float, outer: float, bottom: float, top: float) -> Array:
    """Signed distance to a rectangle in (rho, z): the least of those to its four sides, negative inside."""
    sides = [np.hypot(rho - at, segment(z, bottom, top)) for at in (inner, outer) if np.isfinite(at)]
    sides += [np.hypot(z - at, segment(rho, inner, outer)) for at in (bottom, top) if np.isfinite(at)]
    inside = (inner < rho) & (rho < outer) & (bottom < z) & (z < top)
    return np.where(inside, -1, 1) * np.min(sides, axis=0)


def box_distance(p: Array, low: Array, high: Array) -> Array:
    """Signed distance to a box: the least of those to its six faces, negative inside."""
    gaps, faces = [segment(p[..., k], low[k], high[k]) for k in range(3)], []
    for k in range(3):
        others = np.hypot(*(gaps[j] for j in range(3) if j != k))
        faces += [np.hypot(p[..., k] - at, others) for at in (low[k], high[k])]
    inside = np.all((low < p) & (p < high), axis=-1)
    return np.where(inside, -1, 1) * np.min(faces, axis=0)


def flat_plate_distance(patches: Array, depth: float, p: Array) -> Array:
    """Signed distance to a plate whose top are flat patches that fill a rectangle along the first one's edges."""
    corner = patches[0, 0, 0]
    e, f = unit(patches[0, 3, 0] - corner), unit(patches[0, 0, 3] - corner)
    axes = np.stack([e, f, np.cross(e, f)], axis=-1)
    top = (patches.reshape(-1, 3) - corner) @ axes
    return box_distance(
        (p - corner) @ axes, np.append(top.min(axis=0)[:2], -depth), np.append(top.max(axis=0)[:2], 0.0)
    )


def distance(contact: Contact, p: Array) -> Array:
    """Signed distance of points of b's frame, shape (..., 3), from side b."""
    side = contact.sides[1]
    shape, inf = side.primitive, np.inf
    if side.kind in ("turned", "extruded"):
        return solid_gap(side, p)
    if side.kind == "surface":
        return flat_plate_distance(shape.patches.numbers, shape.depth, p)
    if side.kind == "plane":
        return (p - shape.point) @ np.array(shape.normal)
    if side.kind in ("sphere", "socket"):
        d = np.linalg.norm(p - shape.centre, axis=-1) - shape.radius
        return d if side.kind == "sphere" else -d
    round_kinds = ("cylinder", "bore", "capsule")
    centre, n = (shape.point, shape.axis) if side.kind in round_kinds else (shape.centre, shape.normal)
    w = p - centre
    z = w @ np.array(n)
    rho = np.linalg.norm(np.cross(w, n), axis=-1)
    if side.kind == "capsule":
        return np.hypot(rho, segment(z, -shape.half_length, shape.half_length)) - shape.radius
    if side.kind in ("cylinder", "bore"):
        half = shape.half_length or inf
        inner, outer = (-inf, shape.radius) if side.kind == "cylinder" else (shape.radius, inf)
        return round_distance(rho, z, inner, outer, -half, half)
    if side.kind == "box":
        y = np.cross(n, shape.along)
        half = np.array(shape.half_lengths)
        return box_distance(np.stack([w @ np.array(shape.along), w @ y, z], axis=-1), -half, half)
    if side.kind == "disc":
        return round_distance(rho, z, -inf, shape.radius, -(shape.depth or shape.radius), 0)
    a, b = shape.half_lengths
    own = np.stack([w @ np.array(shape.along), w @ np.cross(n, shape.along), z], axis=-1)
    return box_distance(own, np.array([-a, -b, -(shape.depth or min(a, b))]), np.array([a, b, 0]))


def brute_gap(contact: Contact, poses: "Poses") -> Array:
    """Return the gap at every pose."""
    side = contact.sides[0]
    shape = side.primitive
    if side.kind == "point":
        return distance(contact, poses.seen(np.asarray(shape))) - contact.offset
    if contact.kind == "ring-cylinder":
        pin = contact.sides[1].primitive
        w = poses.seen(np.asarray(shape.centre)) - pin.point
        return shape.radius - pin.radius - np.linalg.norm(np.cross(w, pin.axis), axis=-1) - contact.offset
    if side.kind in ("sphere", "ring"):
        return distance(contact, poses.seen(np.asarray(shape.centre))) - shape.radius - contact.offset
    centre, n, skin = (
        (shape.centre, shape.normal, shape.edge_radius) if side.kind == "arc" else (shape.point, shape.axis, 0.0)
    )
    half = shape.half_angle if side.kind == "arc" else np.pi
    own = getattr(shape, "middle", None)
    e = np.asarray(own) if own else unit(np.cross(n, [0.1, 0.7, -0.4]))
    f = np.cross(n, e)

    def height(angle: Array) -> Array:  # angle: (poses, m)
        on = np.asarray(centre) + shape.radius * (
            np.cos(angle)[..., None] * e + np.sin(angle)[..., None] * f
        )  # (poses, m, 3)
        return distance(contact, poses.seen(on))

    return least(height, half, len(poses)) - skin - contact.offset


def least(height: Any, half: float, n: int) -> Array:
    """Minimise over an angle at n poses: a grid, then a ternary search around its five best valleys."""
    grid = np.linspace(-half, half, GRID)
    values = height(np.broadcast_to(grid, (n, GRID)))
    padded = np.pad(values, ((0, 0), (1, 1)), constant_values=np.inf)
    valley = (values <= padded[:, :-2]) & (values <= padded[:, 2:])
    best = np.argsort(np.where(valley, values, np.inf), axis=1)[:, :5]
    step = grid[1] - grid[0]
    low, high = np.maximum(grid[best] - step, -half), np.minimum(grid[best] + step, half)
    for _ in range(60):
        one, two = low + (high - low) / 3, high - (high - low) / 3
        left = height(one) < height(two)
        low, high = np.where(left, low, one), np.where(left, two, high)
    return np.minimum(height(low).min(axis=1), values.min(axis=1))


# ---------------------------------------------------------------------------------------------------------------------
# the engine, at the same poses


@dataclass
class Poses:
    """Places and turns of two bodies, many at once: shapes (n, 3) and (n, 3, 3) each."""

    x: tuple[Array, Array]
    R: tuple[Array, Array]

    def __len__(self) -> int:
        return len(self.x[0])

    def seen(self, p: Array) -> Array:
        """Return points of a's frame, shape (3,) or (n, m, 3), in the frame of b."""
        if p.ndim == 1:
            world = self.R[0] @ p + self.x[0]
            return np.einsum("nji,nj->ni", self.R[1], world - self.x[1])
        world = np.einsum("nij,nmj->nmi", self.R[0], p) + self.x[0][:, None]
        return np.einsum("nji,nmj->nmi", self.R[1], world - self.x[1][:, None])

    def at(self, i: int) -> "Poses":
        """Return one of the poses."""
        own = slice(i, i + 1)
        return Poses((self.x[0][own], self.x[1][own]), (self.R[0][own], self.R[1][own]))

    def moved(self, twist: tuple[Array, Array], dt: float) -> "Poses":
        """Return the poses after dt; twists (n, 6): velocity in the world, spin in the body."""
        x = tuple(x + dt * v[:, :3] for x, v in zip(self.x, twist, strict=True))
        R = tuple(R @ Rotation.from_rotvec(dt * v[:, 3:]).as_matrix() for R, v in zip(self.R, twist, strict=True))
        return Poses(x, R)  # type: ignore[arg-type]


def scattered(n: int, rng: np.random.Generator, spread: float = 1.0) -> Poses:
    """Place and turn two bodies at random, n times."""
    x = spread * rng.normal(size=(2, n, 3))
    R = Rotation.random(2 * n, random_state=rng).as_matrix().reshape(2, n, 3, 3)
    return Poses((x[0], x[1]), (R[0], R[1]))


def twists(n: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Draw a twist of each body, n times."""
    v = rng.normal(size=(2, n, 6))
    return v[0], v[1]


def compiled(contact: Contact, n: int) -> Contacts:
    """Return a contact as the engine's arrays, n times: between bodies i and n + i."""
    geometry_a, geometry_b, clearance = rows(contact, OWN, OWN)
    b = contact.sides[1]
    pieces, tree = profile_pieces(b), surface_tree(b.surface, OWN) if b.kind == "surface" else None
    pair = Pair("C", KINDS[contact.kind], 0, 0, geometry_a, geometry_b, clearance, (0.0, 0.0), pieces, surface=tree)
    contacts, _ = contact_arrays([pair] * n, np.zeros(n, np.int64))
    return contacts._replace(a=np.arange(n), b=np.arange(n, 2 * n))


def found(contact: Contact, poses: Poses) -> tuple[Array, Array, Array]:
    """Return the engine's gaps (n,), points (n, 3) and frames (n, 3, 3)."""
    n = len(poses)
    gap, point, frame = np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3, 3))
    find_contacts(compiled(contact, n), np.concatenate(poses.x), np.concatenate(poses.R), gap, point, frame)
    return gap, point, frame
