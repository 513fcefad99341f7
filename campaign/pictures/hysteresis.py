"""The picture of a test bench: one response against another, such as the force of a probe against its way."""

from itertools import pairwise
from pathlib import Path

import numpy as np

from campaign.pictures.curves import cut_range, file_metadata, heading
from campaign.pictures.style import DASHES, GRID, PALETTE, STYLE, labelled
from campaign.pictures.view import Array
from engine import Trajectory

SIZE = (6.4, 4.4)  # inches
STILL = 1e-6  # a way that changes by less than this share of its range stands still


def plot_loop(trajectory: Trajectory, path: Path) -> None:
    """Write y against x, as the mechanism's ``plot`` names them; ``.png``, ``.svg`` or ``.pdf``.

    The way forward is solid, the way back dashed: between them lies the hysteresis.
    """
    import matplotlib
    from matplotlib.figure import Figure

    named = trajectory.description["plot"]
    x, y = (trajectory.responses[named[axis]] for axis in ("x", "y"))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=SIZE, layout="constrained")
        figure.suptitle(heading(trajectory), x=0.01, ha="left", fontsize=10)
        axes = figure.subplots()
        labels = {1: "forward", -1: "back"}
        for way, first, last in strokes(x):
            style = 0 if way > 0 else 1
            part = slice(first, last + 1)
            axes.plot(x[part], y[part], color=PALETTE[style], linestyle=DASHES[style], label=labels.pop(way, None))
        for setter, axis in ((axes.set_xlabel, "x"), (axes.set_ylabel, "y")):
            name = named[axis]
            title = trajectory.description["responses"][name].get("title") or name
            setter(labelled(title, trajectory.units[f"responses/{name}"]))
        if (cut := cut_range(y)) is not None:
            axes.set_ylim(*cut)
        axes.grid(color=GRID, linewidth=0.7)
        axes.legend(loc="best", fontsize=8, frameon=False)
        figure.savefig(path, dpi=130, metadata=file_metadata(path.suffix, described(trajectory)))


def strokes(x: Array) -> list[tuple[int, int, int]]:
    """Return the pieces of a way between its turns, (1 forward or -1 back, first index, last index)."""
    still = STILL * float(np.ptp(x)) if x.size else 0.0
    turns, way = [0], 0
    for i in range(1, x.size):
        d = x[i] - x[turns[-1]] if way == 0 else x[i] - x[i - 1]
        sign = 0 if abs(d) <= still else int(np.sign(d))
        if sign and way and sign != way:
            turns.append(i - 1)
        way = sign or way
    ends = [*turns, x.size - 1]
    return [(1 if x[b] >= x[a] else -1, a, b) for a, b in pairwise(ends) if b > a]


def described(trajectory: Trajectory) -> str:
    """Return in words what the figure shows."""
    named = trajectory.description["plot"]
    x, y = trajectory.responses[named["x"]], trajectory.responses[named["y"]]
    top = int(np.argmax(y))
    of_x, of_y = (trajectory.units[f"responses/{named[axis]}"] for axis in ("x", "y"))
    return (
        f"{heading(trajectory)}. {named['y']} against {named['x']}: from {x.min():.5g} to {x.max():.5g} {of_x}, "
        f"largest {y[top]:.5g} {of_y} at {x[top]:.5g} {of_x}."
    )
