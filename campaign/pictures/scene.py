"""All that an animation shows, as numbers: shapes, contact forces and play, projected, frame by frame."""

from dataclasses import dataclass

import numpy as np

from campaign.pictures.parts import links, part_of
from campaign.pictures.play import Play, plays
from campaign.pictures.poses import Pose, finite_rows, poses, progress, spread_rows
from campaign.pictures.view import Array, Rows, View, choose_view
from engine import Mechanism, Trajectory

NEAR = 0.02  # a contact marks its plane where its gap is smaller than this, in sizes of the mechanism


@dataclass(frozen=True)
class Drawn:
    """A body as drawn in ``m`` frames; polylines (m, k, 2)."""

    fixed: bool
    outline: Array
    lines: tuple[Array, ...]
    faces: tuple[Array, ...]
    joints: Array


@dataclass(frozen=True)
class Scene:
    """What is drawn in ``m`` frames.

    Attributes
    ----------
    rows, time : (m,) rows of the trajectory, and their time
    bodies : by name
    springs : ends of linear springs and dampers, (m, 2, 2) each
    points, forces : (m, nc, 2) contact points, and mean forces since the frame before
    plays : of the joints with clearance, at all rows of the trajectory until it diverges
    box : (2, 2) lower left and upper right corner of all bodies in all frames
    """

    rows: Rows
    time: Array
    bodies: dict[str, Drawn]
    springs: tuple[Array, ...]
    points: Array
    forces: Array
    plays: tuple[Play, ...]
    box: Array


def scene_of(trajectory: Trajectory, frames: int) -> Scene:
    """Return what is to be drawn of a trajectory in at most ``frames`` frames."""
    from engine.trajectory.forces import contact_forces

    mechanism = trajectory.mechanism()
    view, usable = choose_view(mechanism), finite_rows(trajectory)
    rows = spread_rows(progress(trajectory, mechanism, usable), frames)
    at = poses(trajectory, mechanism, rows)
    points, forces = contact_forces(trajectory, rows.tolist())
    size = _size(mechanism, at, points)
    touched = _touched(trajectory, rows, points, NEAR * size)
    bodies = {name: _drawn(mechanism, name, at[name], view, touched, size) for name in mechanism.bodies}
    ends = [[at[end.body].world(np.array([end.point])) for end in link] for link in links(mechanism)]
    everywhere = poses(trajectory, mechanism, np.arange(usable))
    return Scene(
        rows=rows,
        time=trajectory.time[rows],
        bodies=bodies,
        springs=tuple(view.project(np.concatenate(pair, axis=1)) for pair in ends),
        points=view.project(points),
        forces=view.project(forces),
        plays=tuple(plays(mechanism, everywhere, view)),
        box=_box(bodies),
    )


def _size(mechanism: Mechanism, at: dict[str, Pose], points: Array) -> float:
    """Return the largest extent at the start of the points where bodies meet, and of their centres of mass."""
    moving = [(name, body.center_of_mass) for name, body in mechanism.bodies.items() if not body.fixed]
    joints = [(side.body, side.point) for joint in mechanism.joints.values() for side in joint.sides]
    there = [at[name].world(np.array([point]))[0] for name, point in moving + joints]
    return float(np.ptp(np.vstack([points[0], *there]), axis=0).max())


def _touched(trajectory: Trajectory, rows: Rows, points: Array, reach: float) -> dict[str, Array]:
    """Return by contact its point in the world, (m, 3); NaN in the frames in which it is neither near nor nearest."""
    found = {}
    for i, (name, history) in enumerate(trajectory.contacts.items()):
        gap = history.gap[rows]
        found[name] = np.where((gap <= max(reach, gap.min()))[:, None], points[:, i], np.nan)
    return found


def _drawn(mechanism: Mechanism, name: str, pose: Pose, view: View, touched: dict[str, Array], size: float) -> Drawn:
    """Return a body in all frames."""
    part = part_of(mechanism, name, view, {contact: pose.local(where) for contact, where in touched.items()}, size)
    outline, joints, *more = [
        view.project(pose.world(points)) for points in (part.outline, part.joints, *part.lines, *part.faces)
    ]
    lines = len(part.lines)
    return Drawn(mechanism.bodies[name].fixed, outline, tuple(more[:lines]), tuple(more[lines:]), joints)


def _box(bodies: dict[str, Drawn]) -> Array:
    """Return the corners of a box around everything that is drawn of the bodies but the outlines of fixed ones."""
    drawn = [p for f in bodies.values() for p in (*f.lines, *f.faces, f.joints, *(() if f.fixed else (f.outline,)))]
    flat = np.vstack([p.reshape(-1, 2) for p in drawn])
    return np.array([flat.min(axis=0), flat.max(axis=0)])
