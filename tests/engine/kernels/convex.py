"""Distances of convex solids by projections onto each in turn, between two bounds that hold however far these go."""

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from engine.assembly import assemble
from engine.kernels.contact_geometry.gaps import find_contacts
from tests.engine.small import made, small

Array = np.ndarray
ROUNDS = 1500


def two(a: dict[str, Any], b: dict[str, Any], of_a: Any = None, of_b: Any = None, **contact: Any) -> dict[str, Any]:
    """Describe two free bodies with a primitive each; ``of_a`` and ``of_b`` are more keys of the bodies."""
    body = {"mass": 1.0, "inertia": [1.0, 1.0, 1.0]}
    return small(
        bodies={
            "ground": {"fixed": True},
            "a": {**body, "origin": [99.0, 0.0, 0.0], **(of_a or {})},
            "b": {**body, **(of_b or {})},
        },
        contacts={"touch": {"a": {"body": "a", **a}, "b": {"body": "b", **b}, "friction": 0.1, **contact}},
    )


def found(data: dict[str, Any], x: Array, R: Array) -> tuple[Array, Array, Array, tuple[str, ...]]:
    """Return gaps (n, nc), points and frames of the contacts at n poses, x (n, 2, 3) and R (n, 2, 3, 3), of a and b."""
    assembly = assemble(made(data))
    state, contacts = assembly.state, assembly.model.contacts
    at = [int(contacts.a[0]), int(contacts.b[0])]
    n, nc = len(x), len(assembly.contact_names)
    gap, point, frame = np.zeros((n, nc)), np.zeros((n, nc, 3)), np.zeros((n, nc, 3, 3))
    place, turn = state.x.copy(), state.R.copy()
    for i in range(n):
        place[at], turn[at] = x[i], R[i]
        find_contacts(contacts, place, turn, gap[i], point[i], frame[i])
    return gap, point, frame, assembly.contact_names


def scattered(n: int, rng: np.random.Generator, spread: float = 1.0) -> tuple[Array, Array]:
    """Place and turn two bodies at random, n times."""
    x = spread * rng.normal(size=(n, 2, 3))
    return x, Rotation.random(2 * n, random_state=rng).as_matrix().reshape(n, 2, 3, 3)


def nearest(side: dict[str, Any], p: Array) -> Array:
    """Return the points of a solid nearest to points of its frame, (n, 3)."""
    ((kind, shape),) = side.items()
    if kind == "sphere":
        return _within(p - shape["centre"], shape["radius"]) + shape["centre"]
    if kind == "box":
        axes = _axes(shape)
        return np.asarray(shape["centre"]) + np.clip((p - shape["centre"]) @ axes.T, -_half(shape), _half(shape)) @ axes
    u = np.asarray(shape["axis"]) / np.linalg.norm(shape["axis"])
    w = p - shape["point"]
    z = w @ u
    along = np.clip(z, -shape["half_length"], shape["half_length"])[:, None] * u
    if kind == "capsule":
        return shape["point"] + along + _within(w - along, shape["radius"])
    return shape["point"] + along + _within(w - z[:, None] * u, shape["radius"])


def support(side: dict[str, Any], d: Array) -> Array:
    """Return how far a solid reaches along directions of its frame, (n, 3)."""
    ((kind, shape),) = side.items()
    if kind == "sphere":
        return d @ np.asarray(shape["centre"]) + shape["radius"]
    if kind == "box":
        return d @ np.asarray(shape["centre"]) + np.abs(d @ _axes(shape).T) @ _half(shape)
    u = np.asarray(shape["axis"]) / np.linalg.norm(shape["axis"])
    across = 1.0 if kind == "capsule" else np.linalg.norm(np.cross(d, u), axis=1)
    return d @ np.asarray(shape["point"]) + shape["half_length"] * np.abs(d @ u) + shape["radius"] * across


def bounds(a: dict[str, Any], b: dict[str, Any], x: Array, R: Array) -> tuple[Array, Array, Array]:
    """Return a lower and an upper bound of the distance, (n,), and the unit vectors from b to a; 0 if they overlap."""
    q = x[:, 1].copy()
    for _ in range(ROUNDS):
        p = _seen(a, x[:, 0], R[:, 0], q)
        q = _seen(b, x[:, 1], R[:, 1], p)
    upper = np.linalg.norm(p - q, axis=1)
    n = (p - q) / np.where(upper > 0.0, upper, 1.0)[:, None]
    lower = np.sum(n * (x[:, 0] - x[:, 1]), axis=1)
    lower -= support(a, -np.einsum("nji,nj->ni", R[:, 0], n)) + support(b, np.einsum("nji,nj->ni", R[:, 1], n))
    return lower, upper, n


def _seen(side: dict[str, Any], x: Array, R: Array, p: Array) -> Array:
    """Return the nearest points of a solid in the world."""
    return x + np.einsum("nij,nj->ni", R, nearest(side, np.einsum("nji,nj->ni", R, p - x)))


def _within(d: Array, radius: float) -> Array:
    """Return vectors, (n, 3), shortened to a length."""
    return d * np.minimum(1.0, radius / np.maximum(np.linalg.norm(d, axis=1), 1e-300))[:, None]


def _axes(shape: dict[str, Any]) -> Array:
    """Return the three axes of a box as rows."""
    n, e = np.asarray(shape["normal"]), np.asarray(shape["along"])
    n, e = n / np.linalg.norm(n), e - (e @ n) * n / (n @ n)
    e = e / np.linalg.norm(e)
    return np.stack([e, np.cross(n, e), n])


def _half(shape: dict[str, Any]) -> Array:
    return np.asarray(shape["half_lengths"])
