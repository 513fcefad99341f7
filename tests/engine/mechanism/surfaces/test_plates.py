"""Surfaces as solids: which edges are open, and that a plate is closed."""

import numpy as np
import pytest

from engine.mechanism.surfaces.patches import (
    basis,
    convex_curvature,
    default_depth,
    largest_depth,
    meeting_edges,
    normals,
    plate,
    points,
)
from engine.mechanism.surfaces.surface import FreeFormSurface
from tests.engine.kernels.surface_shapes import graded_rectangle, half_sphere_bowl, sphere_octant, wavy

Array = np.ndarray
NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)
NODES, WEIGHTS = 0.5 * (NODES + 1), 0.5 * WEIGHTS


def area_and_volume(patches: Array) -> tuple[Array, float]:
    """Return the integral of the normal over patches, which is 0 if they are closed, and the volume they bound."""
    S_u, S_v = points(patches, NODES, NODES, 1, 0), points(patches, NODES, NODES, 0, 1)
    n = np.einsum("nabk,a,b->nabk", np.cross(S_u, S_v), WEIGHTS, WEIGHTS)
    return n.sum(axis=(0, 1, 2)), float(np.sum(n * points(patches, NODES, NODES)) / 3)


SHEETS = {
    "wavy": wavy(),
    "octant": sphere_octant(5.0, conversion=1e-3),
    "bowl": half_sphere_bowl(5.0, conversion=1e-2),
    "flat": {"patches": graded_rectangle(2.0, 1.0).tolist()},
}


@pytest.mark.parametrize("name", SHEETS)
def test_a_plate_is_closed_and_has_the_volume_of_its_layer(name):
    """A thin layer has the volume of its area times its thickness; its back is no exact offset, but almost."""
    surface = FreeFormSurface.model_validate(SHEETS[name])
    sizes = {}
    for depth in (0.02, 0.01):
        patches = plate(surface.top, meeting_edges(surface.top), depth)
        area, volume = area_and_volume(patches)
        np.testing.assert_allclose(area, 0, atol=1e-9)
        assert volume > 0
        assert not meeting_edges(patches).is_open.any()
        sizes[depth] = volume
    S = np.linalg.norm(
        np.cross(points(surface.top, NODES, NODES, 1, 0), points(surface.top, NODES, NODES, 0, 1)), axis=-1
    )
    whole = float(np.einsum("nab,a,b->", S, WEIGHTS, WEIGHTS))
    assert (4 * sizes[0.01] - sizes[0.02]) / 0.02 == pytest.approx(whole, rel=1e-2)


def test_edges_of_a_grid_are_open_only_at_its_border():
    meeting = meeting_edges(graded_rectangle(2.0, 1.0, (3, 4)))
    assert meeting.is_open.sum() == 2 * (3 + 4)
    assert meeting.opposed == []


def test_a_seam_and_a_pole_are_not_open():
    """Half a sphere: its rim is open, the seam and the point at the bottom are not."""
    bowl = FreeFormSurface.model_validate(SHEETS["bowl"])
    edges = meeting_edges(bowl.top)
    rim = edges.edges[edges.is_open]
    np.testing.assert_allclose(rim[..., 2], 0, atol=1e-12)


def test_an_edge_that_is_a_part_of_another_is_not_open():
    """One patch beside two: the patches meet, though no control points are the same."""
    left = graded_rectangle(1.0, 1.0, (1, 1)) - [1, 0, 0]
    right = graded_rectangle(1.0, 1.0, (1, 2)) + np.array([1, 0, 0])
    assert meeting_edges(np.concatenate([left, right])).is_open.sum() == 3 + 4
    apart = meeting_edges(np.concatenate([left, right + np.array([0.1, 0, 0])]))
    assert apart.is_open.sum() == 4 + 6


def test_normals_on_different_sides_are_found():
    patches = graded_rectangle(2.0, 1.0, (1, 2))
    patches[1] = patches[1].transpose(1, 0, 2)
    assert meeting_edges(patches).opposed == [(0, 1)]


def test_curvature_counts_where_a_surface_turns_away_from_its_normals():
    octant, bowl = (FreeFormSurface.model_validate(SHEETS[name]).top for name in ("octant", "bowl"))
    assert convex_curvature(octant) == pytest.approx(0.2, rel=0.02)
    assert convex_curvature(bowl) == pytest.approx(0.0, abs=1e-3)
    assert default_depth(octant) == pytest.approx(5.0 / 4)
    assert largest_depth(octant) == pytest.approx(4.5, rel=0.02)
    assert largest_depth(graded_rectangle(2.0, 1.0)) == np.inf


def test_normals_at_a_pole_are_those_of_the_sphere():
    t = np.linspace(0, 1, 4)
    top = FreeFormSurface.model_validate(sphere_octant(5.0, conversion=1e-4)).top
    np.testing.assert_allclose(normals(top, t), points(top, t, t) / 5, atol=2e-3)


def test_basis_is_the_cubic_bernstein_basis_and_its_derivatives():
    t = np.linspace(0, 1, 11)
    value, first, second = basis(t)
    np.testing.assert_allclose(value.sum(axis=1), 1)
    np.testing.assert_allclose(value @ np.arange(4) / 3, t)
    np.testing.assert_allclose(first.sum(axis=1), 0, atol=1e-15)
    np.testing.assert_allclose(np.gradient(value, t, axis=0, edge_order=2)[1:-1], first[1:-1], atol=0.05)
    np.testing.assert_allclose(second @ [0, 0, 0, 1], 6 * t)
