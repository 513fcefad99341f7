"""Primitives as polylines."""

import numpy as np
import pytest

from clearcap.pictures.shapes import circle, patch, primitive_polylines, square
from engine.mechanism.closed_profiles import Extruded, Turned
from engine.mechanism.surfaces.surface import FreeFormSurface
from tests.engine.kernels.surface_shapes import graded_rectangle, wavy

X, Y, Z = np.eye(3)


def test_circle_and_arc():
    """All points at the radius in the plane; an arc from -half to +half about its middle."""
    points = circle([1, 2, 3], Z, 2.0)
    np.testing.assert_allclose(np.linalg.norm(points - [1, 2, 3], axis=1), 2)
    np.testing.assert_allclose(points[:, 2], 3)
    np.testing.assert_allclose(points[0], points[-1])
    arc = circle([0, 0, 0], Z, 1.0, X, np.pi / 2)
    np.testing.assert_allclose(arc[[0, 24, -1]], [-Y, X, Y], atol=1e-15)


def test_patch_covers_what_is_touched():
    """The square of a plane reaches beyond all touched points, and lies in the plane."""
    touched = np.array([[0, 0, 1.0], [4, 0, 1.0], [np.nan] * 3])
    corners = patch(Z, touched, -Y, 0.5)
    np.testing.assert_allclose(corners[:, 2], 1)
    assert (corners[:, 0].min(), corners[:, 0].max()) == pytest.approx((-0.5, 4.5))
    np.testing.assert_array_equal(square([0, 0, 0], X, Y)[[0, 2]], [[1, 1, 0], [-1, -1, 0]])


def test_a_turned_solid_is_its_section_and_circles():
    """Both halves of the section across the line of sight, and a circle where the profile has a corner off the axis."""
    cone = Turned.model_validate(
        {"point": [1, 2, 3], "axis": [0, 0, 1], "start": [0, 0], "profile": [{"to": [2, 0]}, {"to": [0, 4]}]}
    )
    lines = primitive_polylines("turned", cone, Y)
    assert len(lines) == 2 * 2 + 1
    assert {tuple(np.round(p - [1, 2, 3], 12)) for line in lines[:4] for p in line} == {
        *((0, 0, 0), (2, 0, 0), (-2, 0, 0), (0, 0, 4))
    }
    np.testing.assert_allclose(np.hypot(*(lines[4] - [1, 2, 3]).T[:2]), 2)
    for line in primitive_polylines("turned", cone, Z):  # seen along its axis
        assert np.all(np.isfinite(line))


def test_an_extruded_solid_is_two_profiles_and_its_edges():
    """Without ends it is one profile, in the plane of its point."""
    half_disc = {
        **{"point": [0, 0, 5], "axis": [0, 0, 1], "along": [1, 0, 0], "start": [1, 0]},
        **{"profile": [{"to": [-1, 0], "centre": [0, 0], "turn": "left"}]},
    }
    bottom, top, *edges = primitive_polylines("extruded", Extruded.model_validate({**half_disc, "half_length": 2}), Y)
    np.testing.assert_allclose((bottom[:, 2], top[:, 2]), ([3] * len(bottom), [7] * len(top)))
    np.testing.assert_allclose(np.hypot(*bottom[:25].T[:2]), 1)
    assert len(bottom) > 25
    assert bottom[:, 1].min() == pytest.approx(0, abs=1e-15)
    assert [edge.tolist() for edge in edges] == [
        [[1, 0, 3], [1, 0, 7]],
        [[pytest.approx(-1), pytest.approx(0, abs=1e-15), 3], [pytest.approx(-1), pytest.approx(0, abs=1e-15), 7]],
    ]
    (only,) = primitive_polylines("extruded", Extruded.model_validate(half_disc), Y)
    np.testing.assert_allclose(only[:, 2], 5)


def test_a_surface_is_its_border_and_lines_between_its_patches():
    """A grid of 2 by 3 flat patches: ten edges around it and seven inside, all in its plane."""
    lines = primitive_polylines("surface", FreeFormSurface(patches=graded_rectangle(2.0, 1.0).tolist()), Y)
    assert len(lines) == 10 + 7
    around, inside = np.concatenate(lines[:10]), lines[10:]
    assert np.all(np.maximum(np.abs(around[:, 0]) / 2, np.abs(around[:, 1])) == pytest.approx(1))
    assert all(np.abs(line).min(axis=0)[2] == 0 and np.ptp(line[:, :2], axis=0).min() < 1e-12 for line in inside)
    assert len(primitive_polylines("surface", FreeFormSurface.model_validate(wavy()), Y)) < 200
