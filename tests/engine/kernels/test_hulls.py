"""Convex polyhedra against each other and what else can touch them: distances by other ways, and where they touch."""

from itertools import product
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from tests.counts import many
from tests.each import each
from tests.engine.kernels.convex import found, scattered, two

Array = np.ndarray
PARTNERS = ("mesh", "box", "capsule", "sphere", "point", "plane")
any_partner = each("kind", PARTNERS)
any_seed = given(st.integers(0, 2**32 - 1))
some_draws = settings(max_examples=many(8), deadline=None)


def mesh_of(corners: Any) -> dict[str, Any]:
    """Describe one convex piece."""
    return {"mesh": {"pieces": [np.asarray(corners, float).tolist()]}}


def block(*half: float) -> Array:
    """Return the corners of a box."""
    return np.array(list(product((-1.0, 1.0), repeat=3))) * half


def drawn(kind: str, rng: np.random.Generator) -> tuple[dict[str, Any], Array, float]:
    """Draw a solid; return it, the corners of its core, and its skin."""
    place, radius = 0.3 * rng.normal(size=3), float(rng.uniform(0.1, 0.4))
    if kind == "mesh":
        corners = rng.normal(size=(int(rng.integers(4, 15)), 3)) * rng.uniform(0.3, 1.0, 3)
        return mesh_of(corners), corners, 0.0
    if kind == "box":
        half = rng.uniform(0.2, 1.0, 3)
        return {kind: {"centre": place.tolist(), "half_lengths": half.tolist()}}, place + block(*half), 0.0
    if kind == "capsule":
        arm = rng.normal(size=3)
        shape = {"point": place.tolist(), "axis": arm.tolist(), "radius": radius}
        return (
            {kind: {**shape, "half_length": float(np.linalg.norm(arm))}},
            np.array([place - arm, place + arm]),
            radius,
        )
    if kind == "sphere":
        return {kind: {"centre": place.tolist(), "radius": radius}}, place[None], radius
    if kind == "point":
        return {kind: place.tolist()}, place[None], 0.0
    return {kind: {"point": place.tolist(), "normal": [0.6, 0.0, 0.8]}}, place[None], 0.0


def signed_distance(a: Array, b: Array) -> float:
    """Return the distance of two hulls by quadratic programming, or minus how far one must move to leave the other."""
    differences = (a[:, None] - b[None]).reshape(-1, 3)
    _, residual = nnls(np.vstack([differences.T, np.ones(len(differences))]), np.array([0.0, 0.0, 0.0, 1.0]))
    if residual > 1e-7:  # the least |p|^2 + (1 - sum)^2 over all p = sum * point of the hull: d^2 / (1 + d^2)
        return float(residual / np.sqrt(1.0 - residual**2))
    return float(ConvexHull(differences).equations[:, 3].max())


@any_partner
@some_draws
@any_seed
def test_the_smallest_gap_is_the_signed_distance(kind, seed):
    """Of random polyhedra: by quadratic programming where they are apart, by the hull of all differences elsewhere."""
    rng = np.random.default_rng(seed)
    one, a, _ = drawn("mesh", rng)
    other, b, skin = drawn(kind, rng)
    x, R = scattered(12, rng)
    gap = found(two(one, other), x, R)[0].min(axis=1)
    if kind == "mesh":
        swapped = found(two(other, one), x[:, ::-1], R[:, ::-1])[0].min(axis=1)
        np.testing.assert_allclose(swapped, gap, atol=1e-9)
    for k in range(len(x) if kind in ("mesh", "plane") else 0):
        corners = x[k, 0] + a @ R[k, 0].T
        if kind == "plane":
            expected = ((corners - x[k, 1] - R[k, 1] @ b[0]) @ R[k, 1] @ [0.6, 0.0, 0.8]).min()
        else:
            expected = signed_distance(corners, x[k, 1] + b @ R[k, 1].T)
        assert abs(gap[k] - expected) <= 1e-6
    if kind in ("box", "capsule", "sphere", "point"):  # side a of the kernels is this one
        gap = found(two(other, one), x, R)[0].min(axis=1)
        for k in range(len(x)):
            expected = signed_distance(x[k, 0] + b @ R[k, 0].T, x[k, 1] + a @ R[k, 1].T) - skin
            assert abs(gap[k] - expected) <= 1e-6


def test_blocks_are_boxes():
    """The smallest gaps of two blocks given by their corners are those of two boxes."""
    rng = np.random.default_rng(1)
    one, other = (1.0, 2.0, 0.5), (0.7, 0.6, 1.1)
    x, R = scattered(many(100), rng, 1.2)
    boxes = [{"box": {"centre": [0, 0, 0], "half_lengths": list(half)}} for half in (one, other)]
    expected = found(two(*boxes), x, R)[0].min(axis=1)
    gap = found(two(mesh_of(block(*one)), mesh_of(block(*other))), x, R)[0].min(axis=1)
    assert expected.min() < 0.0 < expected.max()
    np.testing.assert_allclose(gap, expected, atol=1e-12)


@any_partner
def test_gaps_move_along(kind):
    """Moved together, the gaps stay, and points and normals move along."""
    rng = np.random.default_rng(len(kind))
    one, other = drawn("mesh", rng)[0], drawn(kind, rng)[0]
    sides = (one, other) if kind in ("mesh", "plane") else (other, one)
    x, R = scattered(30, rng)
    gap, point, frame, _ = found(two(*sides), x, R)
    there, turn = rng.normal(size=3), Rotation.random(random_state=rng).as_matrix()
    gap_there, point_there, frame_there, _ = found(two(*sides), x @ turn.T + there, turn @ R)
    near = frame[:, :, 0].any(axis=2)
    np.testing.assert_array_equal(frame_there[:, :, 0].any(axis=2), near)
    np.testing.assert_allclose(gap_there[near], gap[near], atol=1e-11)
    np.testing.assert_allclose(point_there[near], point[near] @ turn.T + there, atol=1e-7)
    np.testing.assert_allclose(frame_there[near], frame[near] @ turn.T, atol=1e-7)


@any_partner
def test_gaps_change_no_faster_than_the_bodies_move(kind):
    """1-Lipschitz, apart and overlapping, which the broad phase relies on."""
    rng = np.random.default_rng(7)
    one, corners, _ = drawn("mesh", rng)
    other, core, skin = drawn(kind, rng)
    sides, own = ((one, other), corners) if kind in ("mesh", "plane") else ((other, one), core)
    x, R = scattered(40, rng)
    before = found(two(*sides), x, R)[0].min(axis=1)
    shift, turn = 1e-2 * rng.normal(size=(2, 40, 3))
    x[:, 0] += shift
    R[:, 0] = R[:, 0] @ Rotation.from_rotvec(turn).as_matrix()
    after = found(two(*sides), x, R)[0].min(axis=1)
    reach = np.linalg.norm(own, axis=1).max() + skin
    moved = np.linalg.norm(shift, axis=1) + reach * np.linalg.norm(turn, axis=1)
    assert np.all(np.abs(after - before) <= moved + 1e-12)


def touching(a: dict[str, Any], b: dict[str, Any], *place: float) -> tuple[Array, Array]:
    """Return gaps and points of the contacts that press, body b at the origin and both unturned."""
    x, R = np.array([[place, [0.0, 0.0, 0.0]]]), np.eye(3)[None, None].repeat(2, axis=1)
    gap, point, frame, _ = found(two(a, b), x, R)
    near = frame[0, :, 0].any(axis=1)
    return gap[0, near], point[0, near]


@each("depth", [-1e-3, 0.0, 1e-9, 1e-3])
def test_faces_touch_at_the_corners_of_what_they_have_in_common(depth):
    """Of a triangular prism on a block, with three corners beyond its edges: of the six corners those far apart."""
    prism = np.array([[x, y, z] for z in (-0.5, 0.5) for x, y in ((-1.0, -1.0), (-1.0, 1.0), (2.0, 0.0))])
    gap, point = touching(mesh_of(prism), mesh_of(block(1.5, 0.8, 1.0)), 0.0, 0.0, 1.5 - depth)
    np.testing.assert_allclose(gap, -depth, atol=1e-12)
    y, end = (2.0 - 1.5) / 3.0, 2.0 - 3.0 * 0.8
    expected = [(-1.0, -0.8), (-1.0, 0.8), (end, -0.8), (end, 0.8), (1.5, -y), (1.5, y)]
    apart = np.linalg.norm(point[:, None, :2] - np.array(expected), axis=2)
    np.testing.assert_allclose(apart.min(axis=1), 0.0, atol=1e-9)
    assert len(set(apart.argmin(axis=1).tolist())) == len(point) >= 5
    np.testing.assert_allclose(point[:, 2], 1.0, atol=1e-12)


def test_a_capsule_and_an_edge_lie_with_two_points():
    capsule = {"capsule": {"point": [0, 0, 0], "axis": [1, 0.2, 0], "half_length": 1.0, "radius": 0.3}}
    gap, point = touching(capsule, mesh_of(block(2.0, 2.0, 1.0)), 0.0, 0.0, 1.3)
    assert len(point) == 2
    np.testing.assert_allclose(gap, 0.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(point[0] - point[1]), 2.0, atol=1e-12)
    ridge = mesh_of([[-1, 0, -0.5], [1, 0, -0.5], [-1, -1, 0.5], [-1, 1, 0.5], [1, -1, 0.5], [1, 1, 0.5]])
    gap, point = touching(ridge, mesh_of(block(2.0, 2.0, 1.0)), 0.0, 0.0, 1.5)
    assert len(point) == 2
    np.testing.assert_allclose(np.sort(point[:, 0]), [-1.0, 1.0], atol=1e-12)
