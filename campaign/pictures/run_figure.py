"""The figure of a run: its curves over time, or its hysteresis on a test bench that asks for it."""

from pathlib import Path

from campaign.pictures.curves import plot
from campaign.pictures.hysteresis import plot_hysteresis
from engine import Trajectory


def plot_run(trajectory: Trajectory, path: Path) -> None:
    """Write the figure of a run as ``.png``, ``.svg`` or ``.pdf``."""
    draw = plot_hysteresis if trajectory.description.get("plot") else plot
    draw(trajectory, path)
