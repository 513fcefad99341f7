"""Polarisation: the position of each journal in its bearing at the end of runs, and the direction of its force."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from clearcap.pictures.play import JournalPositions
from clearcap.pictures.run_figure import file_metadata
from clearcap.pictures.style import FORCE, INK, MUTED, PALETTE, hide_axes, styled
from engine.arrays import Array

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
        parts.append(
            f"{journal.joint} ring {journal.ring} presses at {angle:.0f} degrees, eccentricity {eccentricity:.2f}"
        )
    return f"{heading}. {'; '.join(parts)}."


def _draw(axes: "Axes", journal: JournalPositions) -> None:
    """Draw the circle of the clearance, the journal's position in each run, and the direction of its force."""
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
