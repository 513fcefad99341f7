"""The positions of journals in their bearings: the play of joints, magnified, during a run and at the ends of runs."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from clearcap.pictures.style import FORCE, INK, MUTED, PALETTE, file_metadata, hide_axes, styled
from clearcap.pictures.view import Pose, View, choose_view, poses
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
        clearance = joint.play("ring1") if joint.CLEARANCE and not joint.ideal else None
        stations = _stations(joint)
        if clearance is None or clearance <= 0.0 or not len(stations):
            continue
        outer, inner = joint.sides
        centre = body_poses[inner.body].world(np.array([inner.place]))
        if joint.axes is None:
            offset = centre - body_poses[outer.body].world(np.array([outer.place]))
            across = np.tile([view.right, view.up], (len(offset), 1, 1))
            yield Play(name, clearance, view.project(offset) / clearance, across)
            continue
        rings = np.array(outer.place) + np.outer(stations, joint.axes[0])
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
    from engine.trajectory import contact_forces  # compiled code, which other pictures do not need

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
    merged = []
    for of_ring in zip(*runs, strict=True):
        numbers = (np.vstack([getattr(each, key) for each in of_ring]) for key in ("eccentricities", "forces"))
        merged.append(JournalPositions(of_ring[0].joint, of_ring[0].ring, *numbers))
    return merged


if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLUMNS = 8  # joints side by side
PANEL = (1.2, 1.2)  # inches
HEAD, FOOT = 0.6, 0.75  # inches


def plot_polarisation(journals: list[JournalPositions], title: str, path: Path) -> None:
    """Write a round panel for each ring of each joint, from one run or many, as ``.png``, ``.svg`` or ``.pdf``."""
    from matplotlib.figure import Figure

    joints = list(dict.fromkeys(journal.joint for journal in journals))
    rings = max(journal.ring for journal in journals)
    columns, rows = min(len(joints), COLUMNS), rings * -(-len(joints) // COLUMNS)
    runs = len(journals[0].eccentricities)
    width, height = max(columns * PANEL[0] + 0.4, 6.0), rows * PANEL[1] + HEAD + FOOT
    heading = f"{title}: {runs} run{'s' if runs > 1 else ''}"
    with styled():
        figure = Figure(figsize=(width, height))
        figure.suptitle(heading, x=0.02, y=1 - 0.18 / height, va="center", ha="left", fontsize=10)
        for journal in journals:
            line, column = divmod(joints.index(journal.joint), COLUMNS)
            left, top = 0.2 + column * PANEL[0], HEAD + (line * rings + journal.ring - 1) * PANEL[1]
            corner = (left / width, 1 - (top + PANEL[1]) / height)
            _draw(figure.add_axes((*corner, 0.97 * PANEL[0] / width, 0.8 * PANEL[1] / height)), journal)
        key = (
            "Axis of the journal in its bearing, divided by the clearance of its run; on the circle they touch.",
            "Arrow: mean force of the journal on the bearing; it reaches the circle if all runs press the same way.",
        )
        for i, text in enumerate(key):
            figure.text(0.02, (0.42 - 0.2 * i) / height, text, fontsize=8, color=MUTED)
        figure.savefig(path, dpi=130, metadata=file_metadata(path.suffix, describe(journals, heading)))


def mean_direction(journal: JournalPositions) -> Array:
    """Return the mean force divided by its mean magnitude, shape (2,); its length is 1 if all directions agree."""
    mean_size = float(np.linalg.norm(journal.forces, axis=1).mean())
    return np.asarray(journal.forces.mean(axis=0) / (mean_size or 1.0))


def describe(journals: list[JournalPositions], heading: str) -> str:
    """Describe the figure in words."""
    parts = []
    for journal in journals:
        angle = np.degrees(np.arctan2(*mean_direction(journal)[::-1]))
        eccentricity = np.linalg.norm(journal.eccentricities, axis=1).mean()
        name = f"{journal.joint} ring {journal.ring}"
        parts.append(f"{name} presses at {angle:.0f} degrees, eccentricity {eccentricity:.2f}")
    return f"{heading}. {'; '.join(parts)}."


def _draw(axes: "Axes", journal: JournalPositions) -> None:
    from matplotlib.patches import Circle

    hide_axes(axes)
    axes.set(xlim=(-1.15, 1.15), ylim=(-1.15, 1.15))
    axes.set_title(f"{journal.joint}, ring {journal.ring}", loc="center", fontsize=8, color=INK, pad=2)
    axes.add_patch(Circle((0, 0), 1.0, facecolor="#f4f6f9", edgecolor=INK, linewidth=0.9))
    axes.plot([-0.08, 0.08, np.nan, 0, 0], [0, 0, np.nan, -0.08, 0.08], color=MUTED, linewidth=0.8)
    alpha = max(0.15, min(1.0, 8 / len(journal.eccentricities)))
    dots: Any = {"color": PALETTE[0], "markersize": 4, "markeredgewidth": 0, "alpha": alpha, "clip_on": False}
    axes.plot(*journal.eccentricities.T, "o", **dots)
    style: Any = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "width": 0.03}
    axes.quiver([0.0], [0.0], *mean_direction(journal)[:, None], color=FORCE, zorder=5, **style)
