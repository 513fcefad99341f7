"""The poses of bodies, including fixed ones, at the instants of a trajectory."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from clearcap.pictures.view import start_rotation
from engine import Mechanism, Trajectory
from engine.arrays import Array, Integers

TIME_SHARE = 0.3  # share of time in the progress of an animation; the rest is motion
FAR = 1e100  # larger positions count as infinite, because their squares overflow


@dataclass(frozen=True)
class Pose:
    """The frame of a body at ``m`` instants."""

    origin: Array  # in the world [length], (m, 3)
    rotation: Array  # from the body's axes to those of the world, (m, 3, 3)

    def world(self, points: Array) -> Array:
        """Transform points of the body's frame, shape (k, 3), to the world, shape (m, k, 3)."""
        return np.asarray(self.origin[:, None] + np.einsum("mij,kj->mki", self.rotation, points))

    def local(self, points: Array) -> Array:
        """Transform one point of the world per instant, shape (m, 3), to the body's frame, shape (m, 3)."""
        return np.asarray(np.einsum("mij,mi->mj", self.rotation, points - self.origin))

    def direction(self, vector: Array) -> Array:
        """Transform a direction of the body's frame, shape (3,), to the world, shape (m, 3)."""
        return np.asarray(self.rotation @ vector)


def poses(trajectory: Trajectory, mechanism: Mechanism, rows: Integers) -> dict[str, Pose]:
    """Return the pose of every body of the file, by name, at some rows (m,) of the trajectory."""
    by_name = {}
    for name, body in mechanism.bodies.items():
        if body.fixed:
            origin = np.tile(body.origin, (len(rows), 1))
            rotation = np.tile(start_rotation(mechanism, name), (len(rows), 1, 1))
        else:
            motion = trajectory.bodies[name]
            origin = motion.origin[rows]
            rotation = Rotation.from_quat(motion.quaternion[rows], scalar_first=True).as_matrix()
        by_name[name] = Pose(origin, rotation)
    return by_name


def finite_rows(trajectory: Trajectory) -> int:
    """Return the number of rows before the first one whose poses cannot be drawn, because the run diverged."""
    finite = np.ones(len(trajectory.time), bool)
    for motion in trajectory.bodies.values():
        finite &= (np.abs(motion.position) < FAR).all(axis=1) & np.isfinite(motion.quaternion).all(axis=1)
    return int(finite.size if finite.all() else np.argmin(finite))


def progress(trajectory: Trajectory, mechanism: Mechanism, usable: int) -> Array:
    """Return the progress of the motion, from 0 to 1, at each of the first ``usable`` rows, whose poses can be drawn.

    A share of it is time. The rest is, in each step, the path of the body that moves most: the path of its centre of
    mass plus that of a point at its radius of gyration.
    """
    paths = [np.zeros(max(usable - 1, 0))]
    for name, motion in trajectory.bodies.items():
        body = mechanism.bodies[name]
        arm = np.sqrt(np.trace(np.array(body.inertia, float)) / (2 * (body.mass or 1.0)))
        shift, turn = (_lengths(np.diff(x[:usable], axis=0)) for x in (motion.position, motion.quaternion))
        paths.append(shift + 2 * arm * turn)  # a small change of a unit quaternion has half the size of the angle
    time, path = np.diff(trajectory.time[:usable]), np.max(paths, axis=0)
    parts = [(share, steps) for share, steps in ((TIME_SHARE, time), (1 - TIME_SHARE, path)) if steps.sum() > 0]
    done = np.sum([share * np.append(0.0, np.cumsum(steps)) / steps.sum() for share, steps in parts], axis=0)
    return np.asarray(done / done[-1] if parts else np.zeros(usable))


def _lengths(vectors: Array) -> Array:
    return np.asarray(np.linalg.norm(vectors, axis=1))


def spread_rows(done: Array, count: int) -> Integers:
    """Return at most ``count`` increasing rows, with the first and the last, over which ``done`` (n,) is spread evenly.

    ``done`` increases: it is time, or `progress`.
    """
    even = np.linspace(done[0], done[-1], count)
    return np.unique(np.searchsorted(0.5 * (done[1:] + done[:-1]), even))
