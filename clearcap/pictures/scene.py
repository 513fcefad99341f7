"""The numbers behind an animation: shapes, contact forces and play, projected, frame by frame."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from clearcap.pictures.play import Play, plays
from clearcap.pictures.shapes import BodyShape, body_shape, linear_loads
from clearcap.pictures.style import MUTED, PALETTE
from clearcap.pictures.view import Pose, View, choose_view, finite_rows, poses, progress, spread_rows
from engine import Mechanism, Trajectory
from engine.arrays import Array, Integers

COMMON = 95  # percentile of the nonzero forces that gives the common force
ARROW = 0.1  # length of the arrow of the common force, in diagonals of the box
CUT = 2.0  # longer arrows are cut at this multiple of that length
PER_SECOND = 15  # frames
TRAIL = 12  # frames for which the path of a journal stays visible
HOLD = 20  # frames for which the last one stays before the animation begins again
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
    """The content of ``m`` frames, for every way to draw them."""

    name: str
    units: dict[str, str]  # of time, length and force
    rows: Integers  # (m,), of the trajectory
    time: Array  # (m,)
    bodies: dict[str, BodyFrames]
    springs: tuple[Array, ...]  # ends of linear springs and dampers, each (m, 2, 2)
    points: Array  # contact points, (m, nc, 2)
    forces: Array  # mean since the frame before [force], (m, nc, 2)
    plays: tuple[Play, ...]  # of the joints with clearance, at all rows of the trajectory until it diverges
    box: Array  # lower left and upper right corner of all bodies in all frames, (2, 2)

    @cached_property
    def common(self) -> float:
        """A force that many contacts have, see `common_force`."""
        return common_force(self.forces)

    @cached_property
    def long(self) -> float:
        """Length of the arrow of the common force."""
        return ARROW * float(np.linalg.norm(np.diff(self.box, axis=0)))

    @cached_property
    def arrows(self) -> Array:
        """The forces as arrows, (m, nc, 2)."""
        return arrow_lengths(self.forces, self.common, self.long)

    @cached_property
    def corners(self) -> Array:
        """Lower left and upper right corner of the picture, (2, 2)."""
        return limits(self.box, self.points + self.arrows)

    @cached_property
    def colours(self) -> dict[str, str]:
        """Colour of each body."""
        moving = [name for name, body in self.bodies.items() if not body.fixed]
        return dict.fromkeys(self.bodies, MUTED) | {n: PALETTE[i % len(PALETTE)] for i, n in enumerate(moving)}


def scene_of(trajectory: Trajectory, frames: int) -> Scene:
    """Return the scene of a trajectory in at most ``frames`` frames."""
    from engine.trajectory import contact_forces  # compiled code, which other pictures do not need

    mechanism = trajectory.mechanism()
    view, usable = choose_view(mechanism), finite_rows(trajectory)
    rows = spread_rows(progress(trajectory, mechanism, usable), frames)
    body_poses = poses(trajectory, mechanism, rows)
    points, forces = contact_forces(trajectory, rows.tolist())
    size = _size(mechanism, body_poses, points)
    touched = {}  # the point of each contact in the world, (m, 3); NaN if its gap is neither small nor the smallest
    for i, (name, history) in enumerate(trajectory.contacts.items()):
        gap = history.gap[rows]
        touched[name] = np.where((gap <= max(NEAR * size, gap.min()))[:, None], points[:, i], np.nan)
    bodies = {name: _body_frames(mechanism, name, body_poses[name], view, touched, size) for name in mechanism.bodies}
    ends = [[body_poses[end.body].world(np.array([end.point])) for end in link] for link in linear_loads(mechanism)]
    all_poses = poses(trajectory, mechanism, np.arange(usable))
    return Scene(
        name=trajectory.description.get("title") or trajectory.description["name"],
        units={"time": trajectory.units["time"], **{q: mechanism.unit(q) for q in ("length", "force")}},
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


def _body_frames(
    mechanism: Mechanism, name: str, pose: Pose, view: View, touched: dict[str, Array], size: float
) -> BodyFrames:
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


def common_force(forces: Array) -> float:
    """Return a round number (1, 2 or 5 times a power of ten) up to the 95th percentile of forces; 0 without forces."""
    sizes = np.linalg.norm(forces, axis=-1)
    if not (sizes > 0).any():
        return 0.0
    large = float(np.percentile(sizes[sizes > 0], COMMON))
    power = 10.0 ** np.floor(np.log10(large))
    return float(max(digit * power for digit in (1, 2, 5) if digit * power <= large * (1 + 1e-9)))


def arrow_lengths(forces: Array, common: float, long: float) -> Array:
    """Return the forces as arrows; the common force has length ``long``, and none is longer than ``CUT`` times that."""
    if not common:
        return np.zeros_like(forces)
    sizes = np.linalg.norm(forces, axis=-1, keepdims=True) / common
    return np.asarray(forces / common * long * np.minimum(1.0, CUT / np.maximum(sizes, CUT)))


def limits(box: Array, ends: Array) -> Array:
    """Return the corners, lower left and upper right, of a box around bodies and arrow ends, with a margin."""
    flat = np.vstack([box, ends.reshape(-1, 2)])
    corners = np.array([flat.min(axis=0), flat.max(axis=0)])
    margin = 0.06 * float(np.ptp(corners, axis=0).max() or 1.0)
    return np.asarray(corners + np.array([[-margin], [margin]]))


def zigzag(a: Array, b: Array, teeth: int = 8) -> Array:
    """Return the polyline of a spring from a to b, shape (k, 2)."""
    span = b - a
    side = 0.06 * np.array([-span[1], span[0]])
    share = np.array([0.0, 0.15, *np.linspace(0.2, 0.8, teeth), 0.85, 1.0])
    swing = np.array([0.0, 0.0, *np.resize([1.0, -1.0], teeth), 0.0, 0.0])
    return np.asarray(a + share[:, None] * span + swing[:, None] * side)
