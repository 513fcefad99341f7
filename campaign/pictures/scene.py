"""All that an animation shows, as numbers: shapes, contact forces and play, projected, at the instants of its frames."""

from dataclasses import dataclass

import numpy as np

from campaign.pictures.parts import part_of
from campaign.pictures.play import Play, plays
from campaign.pictures.poses import Pose, poses, spread_rows
from campaign.pictures.view import Array, View, choose_view
from engine import Mechanism, Trajectory

NEAR = 0.02  # a contact marks its plane where its gap is smaller than this, in sizes of the mechanism


@dataclass(frozen=True)
class Figure:
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
    plays : of the joints with clearance, at all rows of the trajectory
    box : (2, 2) lower left and upper right corner of all bodies in all frames
    """

    rows: Array
    time: Array
    bodies: dict[str, Figure]
    springs: tuple[Array, ...]
    points: Array
    forces: Array
    plays: tuple[Play, ...]
    box: Array


def scene_of(trajectory: Trajectory, frames: int) -> Scene:
    """Return what is to be drawn of a trajectory in at most ``frames`` frames."""
    from engine.trajectory.forces import contact_forces

    mechanism = trajectory.mechanism()
    view, rows = choose_view(mechanism), spread_rows(trajectory.time, frames)
    at = poses(trajectory, mechanism, rows)
    points, forces = contact_forces(trajectory, rows.tolist())
    size = _size(mechanism, at, points)
    bodies = {}
    for name, body in mechanism.bodies.items():
        part = part_of(mechanism, name, view, _touched(trajectory, mechanism, at[name], rows, points, name, size), size)
        drawn = [view.project(at[name].world(p)) for p in (part.outline, part.joints, *part.lines, *part.faces)]
        n = 2 + len(part.lines)
        bodies[name] = Figure(body.fixed, drawn[0], tuple(drawn[2:n]), tuple(drawn[n:]), drawn[1])
    return Scene(
        rows=rows,
        time=trajectory.time[rows],
        bodies=bodies,
        springs=tuple(_springs(mechanism, at, view)),
        points=view.project(points),
        forces=view.project(forces),
        plays=tuple(plays(mechanism, poses(trajectory, mechanism, np.arange(len(trajectory.time))), view)),
        box=_box(bodies),
    )


def _size(mechanism: Mechanism, at: dict[str, Pose], points: Array) -> float:
    """Return the largest extent at the start of the points where bodies meet, and of their centres of mass."""
    there = [
        points[0],
        *(at[name].world(np.array([b.center_of_mass]))[0] for name, b in mechanism.bodies.items() if not b.fixed),
    ]
    there += [at[s.body].world(np.array([s.point]))[0] for joint in mechanism.joints.values() for s in joint.sides]
    return float(np.ptp(np.vstack(there), axis=0).max())


def _touched(
    trajectory: Trajectory, mechanism: Mechanism, pose: Pose, rows: Array, points: Array, body: str, size: float
) -> dict[str, Array]:
    """Return by contact where it comes near a body, in the body's frame, (k, 3)."""
    found, names = {}, list(trajectory.contacts)
    for name, contact in mechanism.contacts.items():
        if body in (contact.a.body, contact.b.body):
            gap = trajectory.contacts[name].gap[rows]
            near = gap <= max(NEAR * size, gap.min())
            away = points[near, names.index(name)] - pose.origin[near]
            found[name] = np.einsum("mij,mi->mj", pose.rotation[near], away)
    return found


def _springs(mechanism: Mechanism, at: dict[str, Pose], view: View) -> list[Array]:
    """Return the two ends of each linear spring and damper, (m, 2, 2)."""
    linear = [s for s in (*mechanism.springs.values(), *mechanism.dampers.values()) if s.type == "linear"]
    ends = [[at[end.body].world(np.array([end.point])) for end in (s.a, s.b)] for s in linear]
    return [view.project(np.concatenate(pair, axis=1)) for pair in ends]


def _box(bodies: dict[str, Figure]) -> Array:
    """Return the corners of a box around everything that is drawn of the bodies but the outlines of fixed ones."""
    drawn = [p for f in bodies.values() for p in (*f.lines, *f.faces, f.joints, *(() if f.fixed else (f.outline,)))]
    flat = np.vstack([p.reshape(-1, 2) for p in drawn])
    return np.array([flat.min(axis=0), flat.max(axis=0)])
