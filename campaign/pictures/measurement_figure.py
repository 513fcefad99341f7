"""A picture file that shows what the responses of a mechanism measure."""

from pathlib import Path

from campaign.pictures.sketches.sketch import sketch_mechanism
from campaign.pictures.sketches.sketch_canvas import Sketch
from campaign.pictures.sketches.sketch_figure import plot_sketch
from engine import Mechanism


def plot_measurements(mechanism: Mechanism, path: Path) -> None:
    """Write a picture (PNG, SVG or PDF) of the mechanism at its start pose, with what its responses measure."""
    sketch, title = sketch_mechanism(mechanism), mechanism.title or mechanism.name
    plot_sketch(sketch, f"{title}: what is measured", describe(mechanism, sketch), path)


def describe(mechanism: Mechanism, sketch: Sketch) -> str:
    """Describe the picture in words."""
    listed = "; ".join(f"{name}: {', '.join(filter(None, rest))}" for name, *rest, _ in sketch.legend)
    return f"{mechanism.title or mechanism.name} at its start, with arrows for what is measured. {listed}."
