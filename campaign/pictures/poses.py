"""Where bodies are at the instants of a trajectory, also those that never move."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from campaign.pictures.view import Array, Rows, start_rotation
from engine import Mechanism, Trajectory

TIME_COUNTS = 0.3  # share of an animation that is spent evenly in time; the rest goes evenly with what moves
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


def progress(trajectory: Trajectory, mechanism: Mechanism, usable: int) -> Array:
    """Return how much of what there is to see has happened at each of the first rows, shape (usable,), 0 to 1.

    Time counts for a part, and the way of the body that moves most for the rest: of its centre of mass, and of a point
    at its radius of gyration.
    """
    ways = [np.zeros(max(usable - 1, 0))]
    for name, motion in trajectory.bodies.items():
        body = mechanism.bodies[name]
        arm = np.sqrt(np.trace(np.array(body.inertia, float)) / (2 * (body.mass or 1.0)))
        shift, turn = (_lengths(np.diff(x[:usable], axis=0)) for x in (motion.position, motion.quaternion))
        ways.append(shift + 2 * arm * turn)  # a small change of a unit quaternion is half the angle
    time, way = np.diff(trajectory.time[:usable]), np.max(ways, axis=0)
    parts = [(share, steps) for share, steps in ((TIME_COUNTS, time), (1 - TIME_COUNTS, way)) if steps.sum() > 0]
    done = np.sum([share * np.append(0.0, np.cumsum(steps)) / steps.sum() for share, steps in parts], axis=0)
    return np.asarray(done / done[-1] if parts else np.zeros(usable))


def _lengths(vectors: Array) -> Array:
    return np.asarray(np.linalg.norm(vectors, axis=1))


def spread_rows(done: Array, count: int) -> Rows:
    """Return at most ``count`` rows, the first and the last among them, spread as evenly as there are any.

    Parameters
    ----------
    done : (n,) what is to be even between rows, increasing: time, or `progress`
    count : of rows, at most
    """
    wanted = np.linspace(done[0], done[-1], count)
    return np.unique(np.searchsorted(0.5 * (done[1:] + done[:-1]), wanted))
