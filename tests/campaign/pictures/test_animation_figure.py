"""Arrows, springs and limits of an animation's figure."""

import numpy as np
import pytest

from campaign.pictures.animation_figure import arrow_lengths, common_force, join_lines, limits, zigzag


def test_common_force_and_arrows():
    """The key is a round number not above the large forces; a peak is cut at twice the key's arrow."""
    forces = np.array([[[3.0, 4.0], [0.0, 0.0]], [[0.0, 6.0], [0.0, 600.0]]])
    assert common_force(forces[:1]) == 5
    assert common_force(np.zeros((2, 3, 2))) == 0
    assert [common_force(np.array([[[size, 0.0]]])) for size in (1.0, 1.9, 2.0, 0.049, 730)] == [1, 1, 2, 0.02, 500]
    arrows = arrow_lengths(forces, 5.0, 10.0)
    np.testing.assert_allclose(arrows[0], [[6, 8], [0, 0]])
    np.testing.assert_allclose(arrows[1], [[0, 12], [0, 20]])
    assert not arrow_lengths(forces, 0.0, 10.0).any()


def test_limits_hold_bodies_and_arrows():
    """A margin around both; something flat gets one too."""
    corners = limits(np.array([[0.0, 0.0], [2.0, 1.0]]), np.array([[[3.0, 0.5]]]))
    np.testing.assert_allclose(corners, [[-0.18, -0.18], [3.18, 1.18]])
    assert (np.ptp(limits(np.zeros((2, 2)), np.zeros((1, 2))), axis=0) > 0).all()


def test_springs_and_joined_lines():
    """A spring goes from end to end; joined lines have gaps between them."""
    spring = zigzag(np.array([1.0, 1.0]), np.array([3.0, 1.0]))
    np.testing.assert_allclose(spring[[0, -1]], [[1, 1], [3, 1]])
    assert np.ptp(spring[:, 1]) == pytest.approx(0.24)
    lines = join_lines([np.zeros((2, 2)), np.ones((3, 2))])
    np.testing.assert_array_equal(np.isnan(lines[:, 0]), [1, 0, 0, 1, 0, 0, 0, 1])
