"""Where bodies are at the instants of a trajectory, also those that never move."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from campaign.pictures.view import Array, Rows, start_rotation
from engine import Mechanism, Trajectory

FAR = 1e100  # positions beyond are as good as infinite: their squares soon are


@dataclass(frozen=True)
class Pose:
    """A body's own frame at ``m`` instants: origins (m, 3), rotations to the world (m, 3, 3)."""

    origin: Array
    rotation: Array

    def world(self, points: Array) -> Array:
        """Return points of the body's frame, shape (k, 3), in the world, shape (m, k, 3)."""
        return np.asarray(self.origin[:, None] + np.einsum("mij,kj->mki", self.rotation, points))

    def local(self, points: Array) -> Array:
        """Return a point of the world at each instant, shape (m, 3), in the body's frame, shape (m, 3)."""
        return np.asarray(np.einsum("mij,mi->mj", self.rotation, points - self.origin))

    def direction(self, vector: Array) -> Array:
        """Return a direction of the body's frame, shape (3,), in the world, shape (m, 3)."""
        return np.asarray(self.rotation @ vector)


def poses(trajectory: Trajectory, mechanism: Mechanism, instants: Rows) -> dict[str, Pose]:
    """Return the pose of every body of the file at some rows of the trajectory, by name."""
    found = {}
    for name, body in mechanism.bodies.items():
        if body.fixed:
            origin = np.tile(body.origin, (len(instants), 1))
            rotation = np.tile(start_rotation(mechanism, name), (len(instants), 1, 1))
        else:
            motion = trajectory.bodies[name]
            origin = motion.origin[instants]
            rotation = Rotation.from_quat(motion.quaternion[instants], scalar_first=True).as_matrix()
        found[name] = Pose(origin, rotation)
    return found


def finite_rows(trajectory: Trajectory) -> int:
    """Return how many rows there are before the first whose poses cannot be drawn: a run may diverge."""
    finite = np.ones(len(trajectory.time), bool)
    for motion in trajectory.bodies.values():
        finite &= (np.abs(motion.position) < FAR).all(axis=1) & np.isfinite(motion.quaternion).all(axis=1)
    return int(finite.size if finite.all() else np.argmin(finite))


def spread_rows(time: Array, count: int) -> Rows:
    """Return at most ``count`` rows, the first and the last among them, as evenly spaced in time as there are any."""
    wanted = np.linspace(time[0], time[-1], count)
    return np.unique(np.searchsorted(0.5 * (time[1:] + time[:-1]), wanted))
