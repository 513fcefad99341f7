"""The figure of a run: its curves over time, or its hysteresis on a test bench that asks for it."""

import textwrap
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from clearcap.pictures.style import DASHES, GRID, INK, MUTED, PALETTE, file_metadata, label_with_unit, styled
from engine import Trajectory
from engine.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COMMON, OUTSIDE = 98, 3.0  # percentile of common values; a peak beyond this many of their ranges is cut
PANEL = (4.6, 1.75)  # inches
LINE = 130  # characters of a line of the heading
HYSTERESIS_SIZE = (6.4, 4.4)  # inches
STILL = 1e-6  # share of the range of x; a smaller change is not a motion


def plot_run(trajectory: Trajectory, path: Path) -> None:
    """Write the figure of a run as ``.png``, ``.svg`` or ``.pdf``; its metadata describe it in words."""
    draw = plot_hysteresis if trajectory.description.get("plot") else plot
    draw(trajectory, path)


@dataclass(frozen=True)
class Panel:
    """One graph over time."""

    title: str
    axis: str  # label of the vertical axis
    unit: str  # of the vertical axis
    curves: dict[str, Array]  # values over time by name, each of shape (n,)


def plot(trajectory: Trajectory, path: Path) -> None:
    """Write the curves over time."""
    from matplotlib.figure import Figure

    shown = panels(trajectory)
    rows = -(-len(shown) // 2)
    with styled():
        figure = Figure(figsize=(2 * PANEL[0], rows * PANEL[1] + 0.8), layout="constrained")
        figure.suptitle(heading(trajectory), x=0.01, ha="left", fontsize=10)
        grid = figure.subplots(rows, 2, sharex=True, squeeze=False)
        for axes, panel in zip(grid.flat, shown, strict=False):
            _draw(axes, trajectory.time, panel)
        for axes in grid.flat[len(shown) :]:
            axes.set_visible(False)
        for axes in grid.flat[max(len(shown) - 2, 0) : len(shown)]:
            axes.set_xlabel(label_with_unit("time", trajectory.units["time"]))
            axes.tick_params(labelbottom=True)
        figure.savefig(path, dpi=130, metadata=file_metadata(path.suffix, describe(trajectory, shown)))


def panels(trajectory: Trajectory) -> list[Panel]:
    """Return the panels: one for each response, then energy, active contacts and the largest contact force."""
    units, contacts = trajectory.units, trajectory.contacts
    shown = []
    for name, values in trajectory.responses.items():
        if np.isnan(values).all():
            continue  # computed from other responses, after the run
        title = trajectory.description["responses"][name].get("title")
        shown.append(Panel(f"{name}: {title}" if title else name, name, units[f"responses/{name}"], {name: values}))
    energy, stored = {"kinetic": trajectory.kinetic}, trajectory.potential - trajectory.potential[0]
    if stored.any():
        energy |= {"potential": stored, "sum": trajectory.kinetic + stored}
    shown.append(Panel("energy; potential energy from its start", "energy", units["energy/kinetic"], energy))
    if contacts:
        active = np.sum([contact.active for contact in contacts.values()], axis=0)
        shown.append(Panel(f"active contacts, of {len(contacts)}", "number", "1", {"active contacts": active}))
        largest = np.max([np.linalg.norm(trajectory.force(name), axis=1) for name in contacts], axis=0)
        unit = trajectory.mechanism().unit("force")
        shown.append(Panel("largest contact force, mean of each step", "force", unit, {"largest force": largest}))
    return shown


def describe(trajectory: Trajectory, shown: list[Panel]) -> str:
    """Describe the figure in words: for each curve its last, smallest and largest value."""
    parts = [
        f"{name} ends at {values[-1]:.5g}, between {values.min():.5g} and {values.max():.5g}"
        f"{'' if panel.unit == '1' else ' ' + panel.unit}"
        for panel in shown
        for name, values in panel.curves.items()
    ]
    return f"{heading(trajectory)}. " + "; ".join(parts) + "."


def heading(trajectory: Trajectory) -> str:
    """Return the name of the mechanism, how the run ended, and the message of a failed run."""
    name = trajectory.description.get("title") or trajectory.description["name"]
    end = f"{trajectory.time[-1]:.4g} {trajectory.units['time']}"
    message = textwrap.wrap(trajectory.message, LINE)
    return "\n".join([f"{name}: {trajectory.status} at t = {end}", *message])


def cut_range(values: Array) -> tuple[float, float] | None:
    """Return the lowest and highest value to show if a few values lie far outside of the others; None if all fit."""
    values = values[np.isfinite(values)]  # a run may diverge
    if not values.size:
        return None
    low, high = np.percentile(values, [100 - COMMON, COMMON])
    margin = OUTSIDE * (high - low)
    if not margin or (values.max() <= high + margin and values.min() >= low - margin):
        return None
    return max(float(values.min()), float(low - 0.3 * margin)), min(float(values.max()), float(high + 0.3 * margin))


def _draw(axes: "Axes", time: Array, panel: Panel) -> None:
    counts = panel.axis == "number"
    draw: Callable[..., Any] = axes.step if counts else axes.plot  # a count is for the step that ends here
    for i, (name, values) in enumerate(panel.curves.items()):
        draw(time, values, color=PALETTE[i], linestyle=DASHES[i], label=name)
    axes.set_title(panel.title, color=INK)
    axes.set_ylabel(label_with_unit(panel.axis, panel.unit))
    axes.margins(x=0.01)
    axes.grid(color=GRID, linewidth=0.7)
    axes.locator_params(axis="y", nbins=5, integer=counts)
    axes.ticklabel_format(useOffset=False, scilimits=(-4, 5))
    if len(panel.curves) > 1:
        axes.legend(loc="best", fontsize=8, frameon=False, ncols=3)
    everything = np.concatenate(list(panel.curves.values()))
    if (cut := cut_range(everything)) is not None:
        margin = 0.05 * (cut[1] - cut[0])
        axes.set_ylim(cut[0] - margin, cut[1] + margin)
        text = f"cut: {everything.min():.3g} to {everything.max():.3g}"
        axes.text(0.99, 0.96, text, transform=axes.transAxes, ha="right", va="top", fontsize=8, color=MUTED)


def plot_hysteresis(trajectory: Trajectory, path: Path) -> None:
    """Write the figure of y against x, as named in the mechanism's ``plot``: forward strokes solid, backward dashed."""
    from matplotlib.figure import Figure

    names = trajectory.description["plot"]
    x, y = (trajectory.responses[names[axis]] for axis in ("x", "y"))
    with styled():
        figure = Figure(figsize=HYSTERESIS_SIZE, layout="constrained")
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
        figure.savefig(path, dpi=130, metadata=file_metadata(path.suffix, describe_hysteresis(trajectory)))


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


def describe_hysteresis(trajectory: Trajectory) -> str:
    """Describe the figure in words."""
    names = trajectory.description["plot"]
    x, y = trajectory.responses[names["x"]], trajectory.responses[names["y"]]
    top = int(np.argmax(y))
    x_unit, y_unit = (trajectory.units[f"responses/{names[axis]}"] for axis in ("x", "y"))
    span = f"{names['y']} against {names['x']}: from {x.min():.5g} to {x.max():.5g} {x_unit}"
    return f"{heading(trajectory)}. {span}, largest {y[top]:.5g} {y_unit} at {x[top]:.5g} {x_unit}."
