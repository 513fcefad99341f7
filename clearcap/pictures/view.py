"""The plane onto which a spatial mechanism is projected, and the poses of its bodies during a run."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from engine import Mechanism, Trajectory
from engine.arrays import Array, Integers

_TIE_BREAK = np.diag([2e-3, 1e-3, 0.0])  # prefers z to y to x among equally good directions


@dataclass(frozen=True)
class View:
    """A plane of projection."""

    right: Array  # unit vector, (3,), as are the others
    up: Array
    normal: Array  # towards the viewer

    def project(self, points: Array) -> Array:
        """Project points or vectors, shape (..., 3), onto the plane, shape (..., 2)."""
        return np.asarray(points @ np.stack([self.right, self.up], axis=1))


def choose_view(mechanism: Mechanism) -> View:
    """Return the plane to draw a mechanism on; see `best_view`."""
    joints = mechanism.joints.values()
    axes = [start_rotation(mechanism, joint.sides[0].body) @ joint.axes[0] for joint in joints if joint.axes]
    sides = [side for contact in mechanism.contacts.values() for side in (contact.a, contact.b)]
    normals = [start_rotation(mechanism, side.body) @ side.plane.normal for side in sides if side.plane]
    return best_view(axes, normals, np.array(mechanism.gravity))


def best_view(axes: list[Array], normals: list[Array], gravity: Array) -> View:
    """Return the plane normal to most joint axes; without axes, the plane that contains gravity and plane normals best.

    Up is opposite to gravity; without gravity in the plane it is z, or y for a view along z.
    """
    if axes:
        normal = _clean(np.linalg.eigh(_spread(axes) - 1e-3 * _TIE_BREAK).eigenvectors[:, -1])
    else:
        normal = _clean(np.linalg.eigh(_spread([*normals, gravity]) + _TIE_BREAK).eigenvectors[:, 0])
    up = _upwards(normal, gravity)
    right = np.cross(up, normal)
    if right[np.argmax(np.abs(right))] < 0:  # look from the other side, so that larger coordinates are to the right
        normal, right = -normal, -right
    return View(right, up, normal)


def start_rotation(mechanism: Mechanism, body: str) -> Array:
    """Return the rotation from a body's own axes to those of the world at the start, shape (3, 3)."""
    start = mechanism.bodies[body]
    return np.asarray(Rotation.from_rotvec(start.angle * np.array(start.axis)).as_matrix())


def _spread(directions: list[Array]) -> Array:
    """Return the sum of n n' over the unit vectors n of directions; zero vectors are left out."""
    units = [d / np.linalg.norm(d) for d in directions if d.any()]
    return np.asarray(sum((np.outer(n, n) for n in units), np.zeros((3, 3))), float)


def _upwards(normal: Array, gravity: Array) -> Array:
    candidates = (-gravity, np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0]))
    # one with a clear direction in the plane, because it is not nearly along the normal
    across = (c for c in candidates if np.linalg.norm(np.cross(normal, c)) > 0.3 * np.linalg.norm(c))
    direction = next(across)
    up = direction - (direction @ normal) * normal
    return _clean(up / np.linalg.norm(up))


def _clean(vector: Array) -> Array:
    """Return a vector without the rounding errors of the eigenvectors, so that axes of the world stay exact."""
    rounded = np.round(vector, 12) + 0.0
    return np.asarray(rounded / np.linalg.norm(rounded))


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
        ways = (np.diff(x[:usable], axis=0) for x in (motion.position, motion.quaternion))
        shift, turn = (np.linalg.norm(way, axis=1) for way in ways)
        paths.append(shift + 2 * arm * turn)  # a small change of a unit quaternion has half the size of the angle
    time, path = np.diff(trajectory.time[:usable]), np.max(paths, axis=0)
    parts = [(share, steps) for share, steps in ((TIME_SHARE, time), (1 - TIME_SHARE, path)) if steps.sum() > 0]
    done = np.sum([share * np.append(0.0, np.cumsum(steps)) / steps.sum() for share, steps in parts], axis=0)
    return np.asarray(done / done[-1] if parts else np.zeros(usable))


def spread_rows(done: Array, count: int) -> Integers:
    """Return at most ``count`` rows, with the first and the last, over which an increasing ``done`` (n,) is even."""
    even = np.linspace(done[0], done[-1], count)
    return np.unique(np.searchsorted(0.5 * (done[1:] + done[:-1]), even))
