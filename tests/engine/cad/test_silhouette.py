"""Outlines of solids whose shadows are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from engine.cad.cad_model import TriangleMesh
from engine.cad.geometry import perpendicular
from engine.cad.silhouette import silhouette

UP = np.array([0.0, 0.0, 1.0])


def mesh(*points):
    """Return the triangles of the convex hulls of sets of points."""
    vertices, triangles, first = [], [], 0
    for each in points:
        hull = ConvexHull(each)
        vertices.append(each)
        triangles.append(hull.simplices + first)
        first += len(each)
    rows = np.concatenate(triangles).astype(np.int64)
    return TriangleMesh(
        part="p", vertices=np.concatenate(vertices), triangles=rows, faces=np.zeros(len(rows), np.int64)
    )


def block(low, high):
    """Return the corners of a box."""
    return np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])], float)


def area(outline, direction=UP):
    """Return the area of a polygon seen along a direction; positive where it turns counter-clockwise."""
    return float(np.cross(outline, np.roll(outline, -1, axis=0)).sum(axis=0) @ direction / 2)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_a_convex_solid_has_the_shadow_of_its_corners(seed):
    """Also tilted, from any side."""
    random = np.random.default_rng(seed)
    direction = Rotation.random(rng=random).apply(UP)
    corners = random.normal(size=(12, 3))
    shadow = ConvexHull(corners @ perpendicular(direction).T)
    [outline] = silhouette(mesh(corners), direction)
    assert area(outline, direction) == pytest.approx(shadow.volume, rel=0.02)


def test_a_corner_that_looks_inwards():
    """An L of two boxes: six corners, exactly those of the boxes, at mid-height."""
    [outline] = silhouette(mesh(block((0, 0, 0), (10, 2, 4)), block((0, 0, 0), (2, 8, 4))), UP)
    expected = [(0, 0), (10, 0), (10, 2), (2, 2), (2, 8), (0, 8)]
    np.testing.assert_allclose(outline[:, 2], 2.0, atol=1e-12)
    assert area(outline) == pytest.approx(32.0, rel=5e-3)
    for corner in expected:
        assert np.linalg.norm(outline[:, :2] - corner, axis=1).min() < 0.03


def test_what_is_inside_is_left_out_and_what_is_apart_is_not():
    """A frame has one outline, two pieces have two, the larger first."""
    frame = [
        block((0, 0, 0), (9, 1, 1)),
        block((0, 8, 0), (9, 9, 1)),
        block((0, 0, 0), (1, 9, 1)),
        block((8, 0, 0), (9, 9, 1)),
    ]
    [outline] = silhouette(mesh(*frame), UP)
    assert area(outline) == pytest.approx(81.0, rel=1e-6)
    two = silhouette(mesh(block((0, 0, 0), (1, 1, 1)), block((5, 0, 0), (8, 3, 1))), UP)
    assert [area(each) for each in two] == pytest.approx([9.0, 1.0], rel=1e-6)


def test_nothing_has_no_outline():
    """A mesh without triangles."""
    empty = TriangleMesh(part="p", vertices=np.zeros((0, 3)))
    assert silhouette(empty, UP) == []
