"""Frames of the bodies relative to the state's frames, the order of the bodies, and pose and twists at the start."""

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from engine.arrays import Array
from engine.kernels.model import State
from engine.kernels.vectors import rotation_matrix
from engine.mechanism.couplings import GearPair
from engine.mechanism.models import Mechanism


@dataclass(frozen=True)
class BodyFrame:
    """A body's own frame relative to the state's frame: index, and position and rotation from the state's origin.

    A length of the file is ``scale`` times as long, see `Mechanism.stretch`.
    """

    index: int
    origin: Array
    rotation: Array
    quaternion: Array
    scale: float = 1.0

    def point(self, p: Iterable[float]) -> Array:
        """Return a point given in the body's own frame, from the state's origin in the state's axes."""
        return np.asarray(self.origin + self.rotation @ (self.scale * np.asarray(p, float)))

    def direction(self, d: Iterable[float]) -> Array:
        """Return a direction given in the body's own frame as a unit vector in the state's axes."""
        v = self.rotation @ np.asarray(d, float)
        return np.asarray(v / np.linalg.norm(v))


def quaternion(axis: Iterable[float], angle: float) -> Array:
    """Return the unit quaternion (w, x, y, z) of a rotation by ``angle`` [rad] about ``axis``."""
    n = np.asarray(axis, float)
    return np.concatenate(([np.cos(angle / 2)], np.sin(angle / 2) * n / np.linalg.norm(n)))


def rotate(quaternion: Array, vector: Array) -> Array:
    """Return Phi(p) d for unit quaternions p (w, x, y, z), shape (..., 4), and vectors d, shape (..., 3)."""
    w, axis = quaternion[..., :1], quaternion[..., 1:]
    across = np.cross(axis, vector)
    return np.asarray(vector + 2 * (w * across + np.cross(axis, across)))


def tangent(n: Array) -> Array:
    """Return a unit vector perpendicular to n: n x e normalised, with e the coordinate axis most perpendicular to n."""
    x, y, z = map(float, n)
    least = min(abs(x), abs(y), abs(z))
    t = (0.0, z, -y) if abs(x) == least else (-z, 0.0, x) if abs(y) == least else (y, -x, 0.0)
    return np.array(t) / math.hypot(*t)


def order_bodies(mechanism: Mechanism) -> list[str]:
    """Return the names of the moving bodies in an order that keeps bodies in contact close to each other."""
    moving = [name for name, body in mechanism.bodies.items() if not body.fixed]
    number = {name: i for i, name in enumerate(moving)}
    pairs = [(j.sides[0].body, j.sides[1].body) for j in mechanism.joints.values()]
    pairs += [(c.a.body, c.b.body) for c in mechanism.contacts.values()]
    pairs += [(c.gears[0].body, c.gears[1].body) for c in mechanism.couplings.values() if isinstance(c, GearPair)]
    pairs += [(m.body, m.relative_to) for m in mechanism.motions.values() if m.relative_to]
    near: list[set[int]] = [set() for _ in moving]
    for a, b in pairs:
        if a in number and b in number and a != b:
            near[number[a]].add(number[b])
            near[number[b]].add(number[a])
    return [moving[i] for i in cuthill_mckee(near)]


def cuthill_mckee(near: Sequence[Collection[int]]) -> list[int]:
    """Return the nodes of a graph in reverse Cuthill-McKee order, which gives its matrix a narrow band.

    ``near`` holds the neighbours of each node. scipy provides this algorithm, but takes 0.4 s to load, longer than a
    run of the C-60.
    """
    order: list[int] = []
    visited: set[int] = set()
    for start in sorted(range(len(near)), key=lambda i: (len(near[i]), i)):
        queue = [start] if start not in visited else []
        visited.update(queue)
        for node in queue:
            fresh = sorted(set(near[node]) - visited, key=lambda i: (len(near[i]), i))
            visited.update(fresh)
            queue += fresh
        order += queue
    return order[::-1]


def place_bodies(mechanism: Mechanism, moving: list[str]) -> tuple[dict[str, BodyFrame], State]:
    """Return the frame of each body, and the state at the start; fixed bodies share the ground, the world's frame."""
    nb = len(moving)
    x, p, R, v = np.zeros((nb + 1, 3)), np.zeros((nb + 1, 4)), np.zeros((nb + 1, 3, 3)), np.zeros((nb + 1, 6))
    p[nb, 0] = 1.0
    R[nb] = np.eye(3)
    frames = {"world": BodyFrame(nb, np.zeros(3), np.eye(3), p[nb].copy())}
    for name, body in mechanism.bodies.items():
        q, scale = quaternion(body.axis, body.angle), mechanism.stretch(name)
        rotation = np.zeros((3, 3))
        rotation_matrix(q, rotation)
        if body.fixed:
            frames[name] = BodyFrame(nb, np.array(body.origin, float), rotation, q, scale)
            continue
        i, centre = moving.index(name), scale * np.array(body.center_of_mass, float)
        frames[name] = BodyFrame(i, -centre, np.eye(3), p[nb].copy(), scale)
        x[i], p[i], R[i] = np.array(body.origin) + rotation @ centre, q, rotation
        v[i] = [*body.velocity, *body.angular_velocity]
    empty = np.zeros(0)
    return frames, State(x, p, R, v, empty, empty, empty, empty)
