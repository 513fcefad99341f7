"""Rejects in one direction are one part, in several as many: at a corner, on both sides, around a circle."""

import numpy as np
import pytest

from reporting.rare.aim import directions


def around(*centres, n=400, d=2, seed=1):
    """Return normal points around centres, and equal weights."""
    rng = np.random.default_rng(seed)
    points = np.concatenate([np.asarray(centre) + rng.standard_normal((n, d)) for centre in centres])
    return points, np.ones(points.shape[0])


def test_one_direction_is_one_part():
    """Normal points of 7 variables: their mean; with weights, the weighted mean."""
    points, weights = around(np.full(7, 1.8), d=7)
    [(centre, part)], variance = directions(points, weights)
    assert centre == pytest.approx(points.mean(axis=0))
    assert part == 1.0
    assert variance == pytest.approx(1.0, abs=0.1)
    weights = np.where(points[:, 0] > 1.8, 2.0, 1.0)
    assert directions(points, weights)[0][0][0] == pytest.approx(weights @ points / weights.sum())


def test_two_directions_are_two_parts():
    """A quarter of the weight on one side."""
    points, weights = around([5.0, 0.0], [-5.0, 0.0])
    weights[:400] = 1.0 / 3.0
    first, second = sorted(directions(points, weights)[0])
    assert first[0] == pytest.approx([-5.0, 0.0], abs=0.2)
    assert second[0] == pytest.approx([5.0, 0.0], abs=0.2)
    assert first[1] == pytest.approx(0.75, abs=0.01)


def test_a_circle_is_covered():
    """No point of a circle of radius 5 is farther than 2 from a centre."""
    angle = np.random.default_rng(2).uniform(0.0, 2.0 * np.pi, 600)
    points = 5.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    centres = np.array([centre for centre, _ in directions(points, np.ones(600))[0]])
    assert np.min(np.linalg.norm(points[:, None] - centres, axis=2), axis=1).max() < 2.0


def test_a_single_point():
    """It is its own centre."""
    assert directions(np.array([[1.0, -2.0]]), np.array([0.3])) == ((((1.0, -2.0), 1.0),), 1.0)


def test_a_sphere_has_no_directions():
    """Points on a sphere in 20 variables: whatever the centres, they stay far from all."""
    z = np.random.default_rng(3).standard_normal((2000, 20))
    _, variance = directions(8.0 * z / np.linalg.norm(z, axis=1)[:, None], np.ones(2000))
    assert variance > 1.5
