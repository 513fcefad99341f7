"""Poses of bodies, and the rows that become frames."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from clearcap.pictures.view import poses, progress, spread_rows


def test_rows_are_spread_in_time():
    """Evenly in time, not in rows; first and last are there, and none twice."""
    time = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 1.0, 2.0])
    np.testing.assert_array_equal(spread_rows(time, 3), [0, 5, 6])
    np.testing.assert_array_equal(spread_rows(time, 100), np.arange(7))
    np.testing.assert_array_equal(spread_rows(np.zeros(1), 10), [0])


def test_progress_is_time_and_way(pendulum):
    """A body that falls freely, then swings: 0 to 1, growing; at rest time alone counts, and turning is way."""
    mechanism, n = pendulum.mechanism(), len(pendulum.time)
    done = progress(pendulum, mechanism, n)
    assert (done[0], done[-1]) == pytest.approx((0, 1))
    assert (np.diff(done) > 0).all()
    link = pendulum.bodies["link"]
    held = {"position": np.tile(link.position[0], (n, 1)), "quaternion": np.tile(link.quaternion[0], (n, 1))}
    still = replace(pendulum, bodies={"link": replace(link, **held)})
    np.testing.assert_allclose(progress(still, mechanism, n), pendulum.time / pendulum.time[-1], atol=1e-12)
    turn = np.where(np.arange(n)[:, None] < n // 2, 0.0, 0.3) * [[0, 0, 1]]  # at once, in the middle
    held["quaternion"] = Rotation.from_rotvec(turn).as_quat(scalar_first=True)
    jump = np.diff(progress(replace(pendulum, bodies={"link": replace(link, **held)}), mechanism, n))
    assert jump.max() == pytest.approx(0.7 + 0.3 / (n - 1))


def test_poses_of_moving_and_fixed_bodies(pendulum):
    """A point of the link moves as the response says; the ground stays; world and local are inverse."""
    mechanism, rows = pendulum.mechanism(), np.array([0, 250, 500])
    at = poses(pendulum, mechanism, rows)
    tip = at["link"].world(np.array([[0, -0.2, 0.0]]))
    np.testing.assert_allclose(tip[:, 0, 0], pendulum.responses["tip"][rows], atol=1e-15)
    np.testing.assert_array_equal(at["ground"].world(np.eye(3)), np.tile(np.eye(3), (3, 1, 1)))
    np.testing.assert_allclose(at["link"].local(tip[:, 0]), np.tile([0, -0.2, 0], (3, 1)), atol=1e-15)
