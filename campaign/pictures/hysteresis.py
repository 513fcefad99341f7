"""The hysteresis on a test bench: one response against another, such as the force of a probe against its travel."""

from itertools import pairwise
from pathlib import Path

import numpy as np

from campaign.pictures.curves import cut_range, file_metadata, heading
from campaign.pictures.style import DASHES, GRID, PALETTE, label_with_unit, styled
from engine import Trajectory
from engine.arrays import Array

SIZE = (6.4, 4.4)  # inches
STILL = 1e-6  # share of the range of x; a smaller change is not a motion


def plot_hysteresis(trajectory: Trajectory, path: Path) -> None:
    """Write the figure of y against x, as named in the mechanism's ``plot``: forward strokes solid, backward dashed.

    The run is on a test bench; the file is ``.png``, ``.svg`` or ``.pdf``.
    """
    from matplotlib.figure import Figure

    names = trajectory.description["plot"]
    x, y = (trajectory.responses[names[axis]] for axis in ("x", "y"))
    with styled():
        figure = Figure(figsize=SIZE, layout="constrained")
        figure.suptitle(heading(trajectory), x=0.01, ha="left", fontsize=10)
        axes = figure.subplots()
        labels = {1: "forward", -1: "back"}
        for direction, first, last in strokes(x):
            style = 0 if direction > 0 else 1
            rows = slice(first, last + 1)
            label = labels.pop(direction, None)
            axes.plot(x[rows], y[rows], color=PALETTE[style], linestyle=DASHES[style], label=label)
        for setter, axis in ((axes.set_xlabel, "x"), (axes.set_ylabel, "y")):
            name = names[axis]
            title = trajectory.description["responses"][name].get("title") or name
            setter(label_with_unit(title, trajectory.units[f"responses/{name}"]))
        if (cut := cut_range(y)) is not None:
            axes.set_ylim(*cut)
        axes.grid(color=GRID, linewidth=0.7)
        axes.legend(loc="best", fontsize=8, frameon=False)
        figure.savefig(path, dpi=130, metadata=file_metadata(path.suffix, describe(trajectory)))


def strokes(x: Array) -> list[tuple[int, int, int]]:
    """Return direction (1 forward, -1 back), first and last row of each stroke between turning points of x, (n,)."""
    still = STILL * float(np.ptp(x)) if x.size else 0.0
    turns, direction = [0], 0
    for i in range(1, x.size):
        change = x[i] - x[turns[-1]] if direction == 0 else x[i] - x[i - 1]
        sign = 0 if abs(change) <= still else int(np.sign(change))
        if sign and direction and sign != direction:
            turns.append(i - 1)
        direction = sign or direction
    ends = [*turns, x.size - 1]
    return [(1 if x[last] >= x[first] else -1, first, last) for first, last in pairwise(ends) if last > first]


def describe(trajectory: Trajectory) -> str:
    """Describe the figure in words."""
    names = trajectory.description["plot"]
    x, y = trajectory.responses[names["x"]], trajectory.responses[names["y"]]
    top = int(np.argmax(y))
    x_unit, y_unit = (trajectory.units[f"responses/{names[axis]}"] for axis in ("x", "y"))
    return (
        f"{heading(trajectory)}. {names['y']} against {names['x']}: from {x.min():.5g} to {x.max():.5g} {x_unit}, "
        f"largest {y[top]:.5g} {y_unit} at {x[top]:.5g} {x_unit}."
    )
