"""Signed distances from surfaces of bicubic patches: closed forms, brute force, and what always holds."""

import hashlib
import subprocess
import sys
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.assembly.surface_trees import surface_tree
from engine.mechanism.contacts import Contact
from engine.mechanism.surfaces.surface import FreeFormSurface
from tests.counts import many
from tests.engine.kernels.shapes import OWN, Poses, found
from tests.engine.kernels.surface_shapes import (
    graded_rectangle,
    quarter_cylinder,
    searched_distance,
    sphere_octant,
    wavy,
)

Array = np.ndarray


@cache
def contact(name: str) -> Contact:
    """Return a point against one of the surfaces of these tests."""
    octant = sphere_octant(5.0)
    turns = [np.diag([x, y, z]) for x in (1, -1) for y in (1, -1) for z in (1, -1)]
    eighth = FreeFormSurface.model_validate(sphere_octant(5.0, conversion=1e-3)).top
    ball = [eighth @ t if np.linalg.det(t) > 0 else (eighth @ t).transpose(0, 2, 1, 3) for t in turns]
    surfaces: dict[str, dict[str, Any]] = {
        "wavy": wavy(),
        "octant": octant,
        "ball": {"patches": np.concatenate(ball).tolist()},
        "cylinder": quarter_cylinder(2.0, 3.0),
        "plate": {"patches": graded_rectangle(2.0, 1.0).tolist(), "depth": 0.5},
        "twisted": {"patches": [twisted().tolist()], "depth": 0.05},
    }
    side = {"body": "b", "surface": surfaces[name]}
    return Contact.model_validate({"a": {"body": "a", "point": [0, 0, 0]}, "b": side, "friction": 0.1})


def twisted() -> Array:
    """Return one patch of random control points over a square."""
    u, v = np.meshgrid(np.arange(4.0), np.arange(4.0), indexing="ij")
    return np.stack([u, v, 0 * u], axis=-1) + np.random.default_rng(1).normal(scale=0.25, size=(4, 4, 3))


def distances(name: str, q: Array) -> tuple[Array, Array]:
    """Return the signed distances of points, and the normals, of the engine."""
    n = len(q)
    still = np.broadcast_to(np.eye(3), (n, 3, 3)).copy()
    gap, _, frame = found(contact(name), Poses((q, np.zeros((n, 3))), (still, still)))
    return gap, frame[:, 0]


def test_an_eighth_of_a_sphere_by_its_radius():
    """Everywhere over and just under it, at the pole and at its edges, within the error of its conversion."""
    rng, surface = np.random.default_rng(0), contact("octant").b.surface
    out = np.abs(rng.normal(size=(2000, 3)))
    out[:300, :2] *= 10 ** rng.uniform(-12, -2, (300, 1))  # about the pole
    out[300:310] = np.eye(3)[[0, 1, 2, 2, 2, 2, 2, 2, 2, 2]]
    out /= np.linalg.norm(out, axis=1)[:, None]
    height = rng.choice([-0.3, 1.0], 2000) * 10 ** rng.uniform(-8, 0, 2000)
    gap, normal = distances("octant", (5 + height)[:, None] * out)
    assert 0 < surface.conversion_error < 5e-5
    inside = (out.min(axis=1) > 0.1) | (height > 0)  # elsewhere a side of the plate may be nearer from below
    np.testing.assert_allclose(gap[inside], height[inside], rtol=0, atol=surface.conversion_error)
    assert np.abs(normal - out)[height > 0.01].max() < 1e-3


def test_a_quarter_of_a_cylinder_by_its_radius():
    rng = np.random.default_rng(1)
    angle, z = rng.uniform(0.1, 1.4, 500), rng.uniform(0.3, 2.7, 500)
    height = rng.choice([-0.1, 0.1, 2.0], 500) * rng.uniform(0, 1, 500)
    rho = 2 + height
    gap, _ = distances("cylinder", np.stack([rho * np.cos(angle), rho * np.sin(angle), z], axis=-1))
    np.testing.assert_allclose(gap, height, rtol=0, atol=contact("cylinder").b.surface.conversion_error)


def test_a_ball_of_patches_is_negative_inside_also_at_its_centre():
    """All of a sphere is as far from its centre: the one place where no bound helps."""
    rng = np.random.default_rng(2)
    q = np.concatenate([np.zeros((1, 3)), 1e-9 * rng.normal(size=(3, 3)), rng.normal(scale=4, size=(400, 3))])
    gap, normal = distances("ball", q)
    np.testing.assert_allclose(gap, np.linalg.norm(q, axis=1) - 5, atol=1e-3)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1, atol=1e-14)


@pytest.mark.parametrize("name", ["twisted", "wavy"])
def test_the_least_of_all_distances(name):
    """Against a grid of every patch and a search from its best places: no smaller distance is there."""
    rng, patches = np.random.default_rng(3), contact(name).b.surface.boundary
    low, high = patches.reshape(-1, 3).min(axis=0), patches.reshape(-1, 3).max(axis=0)
    q = rng.uniform(low - 1, high + 1, (many(40 if name == "twisted" else 16), 3))
    gap, normal = distances(name, q)
    for k, p in enumerate(q):
        near = np.abs(patches - p).max(axis=(1, 2, 3)) < 2 * (abs(gap[k]) + 2)
        assert abs(gap[k]) == pytest.approx(searched_distance(patches[near], p), abs=1e-9)
        assert searched_distance(patches[near], p - gap[k] * normal[k]) < 1e-6


@settings(max_examples=many(30), deadline=None)
@given(
    name=st.sampled_from(["wavy", "octant", "cylinder", "plate", "twisted"]),
    seed=st.integers(0, 10_000),
    size=st.floats(-9, 1),
)
def test_no_distance_changes_faster_than_the_point_moves(name, seed, size):
    """Anywhere, through the surface, behind it and round its edges."""
    rng, patches = np.random.default_rng(seed), contact(name).b.surface.boundary.reshape(-1, 3)
    low, high = patches.min(axis=0), patches.max(axis=0)
    q = rng.uniform(low - 0.5, high + 0.5, (40, 3))
    moved = q + 10**size * rng.normal(size=q.shape)
    change = np.abs(distances(name, moved)[0] - distances(name, q)[0])
    assert np.all(change <= np.linalg.norm(moved - q, axis=1) + 1e-11)


def test_a_point_goes_through_the_surface_along_its_normal():
    """The gap is the height over the foot of the perpendicular, on both sides, to the last digits."""
    rng = np.random.default_rng(4)
    above = rng.uniform([1, 1, 0.7], [9, 7, 1.0], (many(200), 3))
    gap, normal = distances("wavy", above)
    foot = above - gap[:, None] * normal
    for height in (-0.05, -1e-3, -1e-8, -1e-12, 0.0, 1e-12, 1e-8, 1e-3, 0.05):
        there, n = distances("wavy", foot + height * normal)
        np.testing.assert_allclose(there, height, rtol=0, atol=2e-14)
        np.testing.assert_allclose(n, normal, atol=1e-9)


def test_a_flat_surface_is_a_box():
    """Its plate has faces, edges and corners; the patches are parametrised unevenly."""
    rng = np.random.default_rng(5)
    q = rng.uniform([-3, -2, -1.5], [3, 2, 1], (3000, 3))
    out = np.maximum(np.abs(q) - [2, 1, 0], 0)
    depth = np.maximum(np.maximum(q[:, 2], -0.5 - q[:, 2]), np.maximum(np.abs(q[:, 0]) - 2, np.abs(q[:, 1]) - 1))
    out[:, 2] = np.maximum(np.maximum(q[:, 2], -0.5 - q[:, 2]), 0)
    wanted = np.where(depth > 0, np.linalg.norm(out, axis=1), depth)
    np.testing.assert_allclose(distances("plate", q)[0], wanted, atol=1e-13)


def bits() -> str:
    """Return a digest of distances and normals at many points."""
    q = np.random.default_rng(6).uniform([-1, -1, -1], [11, 9, 2], (500, 3))
    return hashlib.sha256(np.hstack([x.ravel() for x in distances("wavy", q)]).tobytes()).hexdigest()


@pytest.mark.processes
@pytest.mark.bits
def test_the_same_bits_in_another_process():
    code = "from tests.engine.kernels.test_surfaces import bits; print(bits())"
    other = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert other.stdout.strip() == bits()


@pytest.mark.parametrize("name", ["wavy", "octant", "twisted"])
def test_boxes_of_the_tree_hold_what_is_below_them(name: str):
    """The bounds that leave out pieces: every point of a piece is in its slab, and in the boxes of all nodes above."""
    tree, t = surface_tree(contact(name).b.surface, OWN), np.linspace(-1, 1, 5)
    powers = t[:, None] ** np.arange(4)
    points = np.einsum("ai,bj,ncij->nabc", powers, powers, tree.coefficient).reshape(len(tree.bound), -1, 3)
    for node in range(len(tree.after)):
        pieces = tree.piece[node : tree.after[node]]
        pieces = pieces[pieces >= 0]
        away = np.abs(points[pieces[:50]] - tree.box[node, :3])
        assert np.all(away <= tree.box[node, 3:])
    along = np.einsum("nak,npk->npa", tree.slab[:, :, :3], points)
    assert np.all(np.abs(along - tree.slab[:, None, :, 3]) <= tree.slab[:, None, :, 4])


def test_bounds_of_third_derivatives_hold():
    """Those of half the squared distance, by differences at many points of every piece and for points q anywhere."""
    tree, rng = surface_tree(contact("twisted").b.surface, OWN), np.random.default_rng(7)
    for k in range(0, len(tree.bound), 7):
        q = rng.normal(scale=3, size=3)
        own = tree.coefficient[k].copy()
        own[:, 0, 0] -= q
        phi = np.zeros((7, 7))
        for a in own:
            for i in range(4):
                for j in range(4):
                    phi[i : i + 4, j : j + 4] += 0.5 * a[i, j] * a
        x, y = rng.uniform(-1, 1, (2, 50))
        r = np.linalg.norm(np.polynomial.polynomial.polyval2d(x, y, np.moveaxis(own, 0, -1)), axis=0)
        for m, (by_x, by_y) in enumerate(((3, 0), (2, 1), (1, 2), (0, 3))):
            slope = np.polynomial.polynomial.polyder(np.polynomial.polynomial.polyder(phi, by_x, axis=0), by_y, axis=1)
            value = np.abs(np.polynomial.polynomial.polyval2d(x, y, slope))
            assert np.all(value <= tree.bound[k, m] + tree.bound[k, 4 + m] * r + 1e-9)
