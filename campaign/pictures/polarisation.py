"""Polarisation: where each journal lies in its bearing at the end of runs, and which way it presses."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from campaign.pictures.curves import file_metadata
from campaign.pictures.style import FORCE, INK, MUTED, PALETTE, STYLE, bare
from campaign.pictures.view import Array
from campaign.reports.journal_positions import Seat

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLUMNS = 8  # joints beside each other
PANEL = (1.2, 1.2)  # inches
HEAD, FOOT = 0.6, 0.75  # inches


def plot_polarisation(seats: list[Seat], title: str, path: Path) -> None:
    """Write a round panel for each ring of each joint: ``.png``, ``.svg`` or ``.pdf``.

    Parameters
    ----------
    seats : of one run or of many, at least one seat
    title : what ran
    path : the file
    """
    import matplotlib
    from matplotlib.figure import Figure

    joints = list(dict.fromkeys(seat.joint for seat in seats))
    rings = max(seat.ring for seat in seats)
    columns, rows = min(len(joints), COLUMNS), rings * -(-len(joints) // COLUMNS)
    runs = len(seats[0].ways)
    wide, high = max(columns * PANEL[0] + 0.4, 6.0), rows * PANEL[1] + HEAD + FOOT
    said = f"{title}: {runs} run{'s' if runs > 1 else ''}"
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(wide, high))
        figure.suptitle(said, x=0.02, y=1 - 0.18 / high, va="center", ha="left", fontsize=10)
        for seat in seats:
            line, column = divmod(joints.index(seat.joint), COLUMNS)
            left, top = 0.2 + column * PANEL[0], HEAD + (line * rings + seat.ring - 1) * PANEL[1]
            place = (left / wide, 1 - (top + PANEL[1]) / high, 0.97 * PANEL[0] / wide, 0.8 * PANEL[1] / high)
            _draw(figure.add_axes(place), seat)
        key = (
            "Axis of the journal in its bearing, divided by the clearance of its run; on the circle they touch.",
            "Arrow: mean force of the journal on the bearing; it reaches the circle if all runs press the same way.",
        )
        for i, text in enumerate(key):
            figure.text(0.02, (0.42 - 0.2 * i) / high, text, fontsize=8, color=MUTED)
        figure.savefig(path, dpi=130, metadata=file_metadata(path.suffix, described(seats, said)))


def mean_way(seat: Seat) -> Array:
    """Return the mean force divided by the mean of its size, shape (2,): of length 1 if all press the same way."""
    size = float(np.linalg.norm(seat.loads, axis=1).mean())
    return np.asarray(seat.loads.mean(axis=0) / (size or 1.0))


def described(seats: list[Seat], said: str) -> str:
    """Return in words what the figure shows."""
    parts = []
    for seat in seats:
        angle, held = np.degrees(np.arctan2(*mean_way(seat)[::-1])), np.linalg.norm(seat.ways, axis=1).mean()
        parts.append(f"{seat.joint} ring {seat.ring} presses at {angle:.0f} degrees, eccentricity {held:.2f}")
    return f"{said}. {'; '.join(parts)}."


def _draw(axes: "Axes", seat: Seat) -> None:
    """Draw the circle of the clearance, where the journal is in each run, and which way it presses."""
    from matplotlib.patches import Circle

    bare(axes)
    axes.set(xlim=(-1.15, 1.15), ylim=(-1.15, 1.15))
    axes.set_title(f"{seat.joint}, ring {seat.ring}", loc="center", fontsize=8, color=INK, pad=2)
    axes.add_patch(Circle((0, 0), 1.0, facecolor="#f4f6f9", edgecolor=INK, linewidth=0.9))
    axes.plot([-0.08, 0.08, np.nan, 0, 0], [0, 0, np.nan, -0.08, 0.08], color=MUTED, linewidth=0.8)
    alpha = max(0.15, min(1.0, 8 / len(seat.ways)))
    axes.plot(*seat.ways.T, "o", color=PALETTE[0], markersize=4, markeredgewidth=0, alpha=alpha, clip_on=False)
    style: Any = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "width": 0.03}
    axes.quiver([0.0], [0.0], *mean_way(seat)[:, None], color=FORCE, zorder=5, **style)
