"""The positions of journals in their bearings at the end of runs, and their forces on the bearings."""

from dataclasses import dataclass

import numpy as np

from campaign.pictures.play import plays
from campaign.pictures.poses import poses
from campaign.pictures.view import choose_view
from engine import Trajectory
from engine.arrays import Array


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
