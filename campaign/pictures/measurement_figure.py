"""A picture of what the responses of a mechanism measure, as a file."""

from pathlib import Path

from campaign.pictures.sketches.sketch import sketch_mechanism
from campaign.pictures.sketches.sketch_canvas import Sketch
from campaign.pictures.sketches.sketch_figure import plot_sketch
from engine import Mechanism


def plot_measurements(mechanism: Mechanism, path: Path) -> None:
    """Write the mechanism at its start pose, with what its responses measure.

    Parameters
    ----------
    mechanism : Mechanism
        What to draw.
    path : Path
        File to write: ``.png``, ``.svg`` or ``.pdf``.
    """
    sketch, title = sketch_mechanism(mechanism), mechanism.title or mechanism.name
    plot_sketch(sketch, f"{title}: what is measured", describe(mechanism, sketch), path)


def describe(mechanism: Mechanism, sketch: Sketch) -> str:
    """Return in words what the picture shows."""
    listed = "; ".join(f"{name}: {', '.join(filter(None, rest))}" for name, *rest, _ in sketch.legend)
    return f"{mechanism.title or mechanism.name} at its start, with arrows for what is measured. {listed}."
