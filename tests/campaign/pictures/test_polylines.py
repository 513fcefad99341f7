"""Primitives as polylines."""

import numpy as np
import pytest

from campaign.pictures.polylines import circle, patch, square

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
