"""The plane onto which a spatial mechanism is projected."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from engine import Mechanism
from engine.arrays import Array

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
    return best_view(axes, _plane_normals(mechanism), np.array(mechanism.gravity))


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


def _plane_normals(mechanism: Mechanism) -> list[Array]:
    sides = [side for contact in mechanism.contacts.values() for side in (contact.a, contact.b) if side.plane]
    return [start_rotation(mechanism, side.body) @ side.plane.normal for side in sides if side.plane]


def _spread(directions: list[Array]) -> Array:
    """Return the sum of n n' over the unit vectors n of directions; zero vectors are left out."""
    units = [d / np.linalg.norm(d) for d in directions if d.any()]
    return np.asarray(sum((np.outer(n, n) for n in units), np.zeros((3, 3))), float)


def _upwards(normal: Array, gravity: Array) -> Array:
    """Return the unit vector of the plane that points up."""
    candidates = (-gravity, np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0]))
    direction = next(candidate for candidate in candidates if _lies_in(normal, candidate))
    up = direction - (direction @ normal) * normal
    return _clean(up / np.linalg.norm(up))


def _lies_in(normal: Array, vector: Array) -> bool:
    """Return whether a vector has a clear direction in the plane, because it is not nearly along the normal."""
    return bool(np.linalg.norm(np.cross(normal, vector)) > 0.3 * np.linalg.norm(vector))


def _clean(vector: Array) -> Array:
    """Return a vector without the rounding errors of the eigenvectors, so that axes of the world stay exact."""
    rounded = np.round(vector, 12) + 0.0
    return np.asarray(rounded / np.linalg.norm(rounded))
