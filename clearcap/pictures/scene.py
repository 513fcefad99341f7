"""The numbers behind an animation: shapes, contact forces and play, projected, frame by frame."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from clearcap.pictures.body_shapes import BodyShape, body_shape, linear_loads
from clearcap.pictures.play import Play, plays
from clearcap.pictures.poses import Pose, finite_rows, poses, progress, spread_rows
from clearcap.pictures.view import View, choose_view
from engine import Mechanism, Trajectory
from engine.arrays import Array, Integers

NEAR = 0.02  # gap, in sizes of the mechanism, below which a contact point counts for the patch of its plane


@dataclass(frozen=True)
class BodyFrames:
    """A body drawn in ``m`` frames; a point p of the body's own frame is drawn at ``turn @ p + origin``."""

    fixed: bool  # it is part of the ground
    shape: BodyShape  # in its own frame
    turn: Array  # (m, 2, 3), projected rotation from the body's axes to right and up of the drawing
    origin: Array  # (m, 2), in the drawing

    @cached_property
    def outline(self) -> Array:
        """Polygon around it, shape (m, k, 2)."""
        return self._drawn(self.shape.outline)

    @cached_property
    def lines(self) -> tuple[Array, ...]:
        """Polylines of its primitives and pins, each of shape (m, k, 2)."""
        return tuple(map(self._drawn, self.shape.lines))

    @cached_property
    def faces(self) -> tuple[Array, ...]:
        """Patches of planes with contacts, each of shape (m, 5, 2)."""
        return tuple(map(self._drawn, self.shape.faces))

    @cached_property
    def joints(self) -> Array:
        """Positions of its joints, shape (m, k, 2)."""
        return self._drawn(self.shape.joints)

    def _drawn(self, points: Array) -> Array:
        return np.asarray(np.einsum("mij,kj->mki", self.turn, points) + self.origin[:, None])


@dataclass(frozen=True)
class Scene:
    """The content of ``m`` frames."""

    rows: Integers  # (m,), of the trajectory
    time: Array  # (m,)
    bodies: dict[str, BodyFrames]
    springs: tuple[Array, ...]  # ends of linear springs and dampers, each (m, 2, 2)
    points: Array  # contact points, (m, nc, 2)
    forces: Array  # mean since the frame before [force], (m, nc, 2)
    plays: tuple[Play, ...]  # of the joints with clearance, at all rows of the trajectory until it diverges
    box: Array  # lower left and upper right corner of all bodies in all frames, (2, 2)


def scene_of(trajectory: Trajectory, frames: int) -> Scene:
    """Return the scene of a trajectory in at most ``frames`` frames."""
    from engine.trajectory import contact_forces  # compiled code, which other pictures do not need

    mechanism = trajectory.mechanism()
    view, usable = choose_view(mechanism), finite_rows(trajectory)
    rows = spread_rows(progress(trajectory, mechanism, usable), frames)
    body_poses = poses(trajectory, mechanism, rows)
    points, forces = contact_forces(trajectory, rows.tolist())
    size = _size(mechanism, body_poses, points)
    touched = _touched(trajectory, rows, points, NEAR * size)
    bodies = {name: _body_frames(mechanism, name, body_poses[name], view, touched, size) for name in mechanism.bodies}
    ends = [[body_poses[end.body].world(np.array([end.point])) for end in link] for link in linear_loads(mechanism)]
    all_poses = poses(trajectory, mechanism, np.arange(usable))
    return Scene(
        rows=rows,
        time=trajectory.time[rows],
        bodies=bodies,
        springs=tuple(view.project(np.concatenate(pair, axis=1)) for pair in ends),
        points=view.project(points),
        forces=view.project(forces),
        plays=tuple(plays(mechanism, all_poses, view)),
        box=_box(bodies),
    )


def _size(mechanism: Mechanism, body_poses: dict[str, Pose], points: Array) -> float:
    """Return the largest extent, at the start, of contact points, joints and centres of mass of moving bodies."""
    moving = [(name, body.center_of_mass) for name, body in mechanism.bodies.items() if not body.fixed]
    joints = [(side.body, side.point) for joint in mechanism.joints.values() for side in joint.sides]
    meeting = [body_poses[name].world(np.array([point]))[0] for name, point in moving + joints]
    return float(np.ptp(np.vstack([points[0], *meeting]), axis=0).max())


def _touched(trajectory: Trajectory, rows: Integers, points: Array, reach: float) -> dict[str, Array]:
    """Return the point of each contact in the world, shape (m, 3); NaN if its gap is neither small nor the smallest."""
    by_contact = {}
    for i, (name, history) in enumerate(trajectory.contacts.items()):
        gap = history.gap[rows]
        by_contact[name] = np.where((gap <= max(reach, gap.min()))[:, None], points[:, i], np.nan)
    return by_contact


def _body_frames(
    mechanism: Mechanism, name: str, pose: Pose, view: View, touched: dict[str, Array], size: float
) -> BodyFrames:
    """Return a body in all frames."""
    local = {contact: pose.local(points) for contact, points in touched.items()}
    shape = body_shape(mechanism, name, view, local, size)
    turn = np.swapaxes(view.project(np.swapaxes(pose.rotation, 1, 2)), 1, 2)
    return BodyFrames(mechanism.bodies[name].fixed, shape, turn, view.project(pose.origin))


def _box(bodies: dict[str, BodyFrames]) -> Array:
    """Return the corners of a box around everything drawn of the bodies except the outlines of fixed ones."""
    shown = [
        points
        for body in bodies.values()
        for points in (*body.lines, *body.faces, body.joints, *(() if body.fixed else (body.outline,)))
    ]
    flat = np.vstack([points.reshape(-1, 2) for points in shown])
    return np.array([flat.min(axis=0), flat.max(axis=0)])
