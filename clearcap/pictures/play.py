"""The positions of journals in their bearings: the play of joints, magnified, during a run and at the ends of runs."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from clearcap.pictures.poses import Pose, poses
from clearcap.pictures.view import View, choose_view
from engine import Mechanism, Trajectory
from engine.arrays import Array


@dataclass(frozen=True)
class Play:
    """The positions of a journal's axis in the rings of its bearing, or of a ball in its socket, at ``m`` instants."""

    joint: str
    clearance: float  # radius of the circle that limits the axis [length]
    eccentricity: Array  # (m, rings, 2), from the bearing's axis to the journal's, in clearances, along `across`
    across: Array  # (m, 2, 3), unit vectors across the joint's axis in the world, to the right and up in the picture


def plays(mechanism: Mechanism, body_poses: dict[str, Pose], view: View) -> Iterator[Play]:
    """Yield the play of every joint with a circle of clearance (not of the block of a slot) at ``m`` instants."""
    for name, joint in mechanism.joints.items():
        clearance = getattr(joint, joint.CLEARANCE) if joint.CLEARANCE and not joint.ideal else None
        stations = _stations(joint)
        if not clearance or not len(stations):
            continue
        outer, inner = joint.sides
        centre = body_poses[inner.body].world(np.array([inner.point]))
        if joint.axes is None:
            offset = centre - body_poses[outer.body].world(np.array([outer.point]))
            across = np.tile([view.right, view.up], (len(offset), 1, 1))
            yield Play(name, clearance, view.project(offset) / clearance, across)
            continue
        rings = np.array(outer.point) + np.outer(stations, joint.axes[0])
        offset = centre - body_poses[outer.body].world(rings)
        axis = body_poses[inner.body].direction(np.array(joint.axes[1]))[:, None]
        offset -= np.sum(offset * axis, axis=-1, keepdims=True) * axis
        across = _across(axis[:, 0], view)
        yield Play(name, clearance, np.einsum("mri,mki->mrk", offset, across) / clearance, across)


def _stations(joint: Any) -> tuple[float, ...]:
    """Return the stations of the rings along the axis; one for a ball."""
    if joint.axes is None:
        return (0.0,)
    rings: tuple[float, ...] | None = getattr(getattr(joint, "shaft", joint), "rings", None)
    return rings or ()


def _across(axis: Array, view: View) -> Array:
    """Return two unit vectors across each axis, shape (m, 2, 3), as near as possible to the view's right and up."""
    candidates = sorted((view.right, view.up, view.normal), key=lambda v: round(abs(float(axis[0] @ v)), 3))[:2]
    ordered = [v for v in (view.right, view.up, view.normal) if any(v is c for c in candidates)]
    first = ordered[0] - (axis @ ordered[0])[:, None] * axis
    first = first / np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(axis, first)
    return np.stack([first, second * np.sign(second @ ordered[1])[:, None]], axis=1)


@dataclass(frozen=True)
class JournalPositions:
    """A journal in one ring of its bearing, or a ball in its socket, at the ends of ``n`` runs."""

    joint: str
    ring: int  # along the axis, from 1
    # (n, 2), from the bearing's axis to the journal's, divided by the clearance; length 1 if they touch.
    eccentricities: Array
    forces: Array  # (n, 2), of the journal on the bearing [force]


def journal_positions(trajectory: Trajectory) -> list[JournalPositions]:
    """Return the positions of the journals at the end of one run, the trajectory's last row; one entry per ring."""
    from engine.trajectory.forces import contact_forces  # compiled code, which other pictures do not need

    mechanism, last_row = trajectory.mechanism(), np.array([len(trajectory.time) - 1])
    _, forces = contact_forces(trajectory, last_row.tolist())
    force_at = dict(zip(trajectory.contacts, forces[0], strict=True))
    positions = []
    for play in plays(mechanism, poses(trajectory, mechanism, last_row), choose_view(mechanism)):
        on_bearing = -1.0 if mechanism.bodies[mechanism.joints[play.joint].sides[0].body].fixed else 1.0
        contacts = [name for name in force_at if name.startswith((f"{play.joint}.ring", f"{play.joint}.ball"))]
        for ring, contact in enumerate(contacts):
            force = on_bearing * (play.across[0] @ force_at[contact])
            positions.append(JournalPositions(play.joint, ring + 1, play.eccentricity[:, ring], force[None]))
    return positions


def merge_runs(runs: list[list[JournalPositions]]) -> list[JournalPositions]:
    """Merge the positions of several runs of one mechanism, ring by ring."""
    return [
        JournalPositions(
            of_ring[0].joint,
            of_ring[0].ring,
            np.vstack([each.eccentricities for each in of_ring]),
            np.vstack([each.forces for each in of_ring]),
        )
        for of_ring in zip(*runs, strict=True)
    ]
