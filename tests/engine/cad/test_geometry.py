"""Unions of angles, against a count of directions."""

from math import tau

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine.cad.geometry import covered, perpendicular

interval = st.tuples(st.floats(-10.0, 10.0), st.floats(0.01, 6.2))


@given(st.lists(interval, min_size=1, max_size=8))
def test_it_is_what_a_count_finds(intervals):
    """Of 20,000 directions, the share that lies in an interval."""
    starts = np.array([start for start, _ in intervals])
    ends = starts + [length for _, length in intervals]
    directions = np.linspace(0.0, tau, 20_000, endpoint=False)
    inside = (((directions[:, None] - starts) % tau) <= ends - starts).any(axis=1)
    span, middle = covered(starts, ends)
    assert span == pytest.approx(inside.mean() * tau, abs=1e-3 * len(intervals))
    assert 0.0 <= middle <= tau
    if span < tau and len(intervals) == 1:
        assert np.cos(middle - (starts[0] + ends[0]) / 2) == pytest.approx(1.0)


def test_halves_that_touch_are_all_of_it():
    """Also where they meet at the angle that is both 0 and a turn."""
    assert covered(np.array([0.0, np.pi]), np.array([np.pi, tau]))[0] == tau
    assert covered(np.array([-np.pi / 2, np.pi / 2]), np.array([np.pi / 2, 1.5 * np.pi]))[0] == tau


@given(st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3).filter(lambda v: np.linalg.norm(v) > 0.1))
def test_a_frame_is_right_handed(vector):
    """Two unit vectors and the axis, each across the others."""
    axis = np.array(vector) / np.linalg.norm(vector)
    frame = np.vstack([perpendicular(axis), axis])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(frame) == pytest.approx(1.0)
