"""Write a sketch as a file: the canvas, and beside it a legend of the names on it."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from clearcap.pictures.run_figure import file_metadata
from clearcap.pictures.sketches.sketch import sketch_mechanism
from clearcap.pictures.sketches.sketch_canvas import Sketch
from clearcap.pictures.style import INK, MUTED, hide_axes, styled
from engine import Mechanism

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDE, DPI = 9.0, 100  # inches
SHARE = 0.66  # of the width for the mechanism; the rest is for the legend
ROW = 0.5  # inches; height of an entry of the legend
WIDTHS = {"thin": 0.7, "dashed": 0.7, "thick": 2.5, "arrow": 1.3}


def plot_measurements(mechanism: Mechanism, path: Path) -> None:
    """Write a picture (PNG, SVG or PDF) of the mechanism at its start pose, with what its responses measure."""
    sketch, title = sketch_mechanism(mechanism), mechanism.title or mechanism.name
    plot_sketch(sketch, f"{title}: what is measured", describe(mechanism, sketch), path)


def describe(mechanism: Mechanism, sketch: Sketch) -> str:
    """Describe the picture in words."""
    listed = "; ".join(f"{name}: {', '.join(filter(None, rest))}" for name, *rest, _ in sketch.legend)
    return f"{mechanism.title or mechanism.name} at its start, with arrows for what is measured. {listed}."


def plot_sketch(sketch: Sketch, heading: str, description: str, path: Path) -> None:
    """Write a sketch, ``.png``, ``.svg`` or ``.pdf``, with a description for readers who cannot see it."""
    from matplotlib.figure import Figure

    inch = SHARE * WIDE / sketch.width  # per point of the canvas
    tall = max(inch * sketch.height, ROW * len(sketch.legend)) + 0.5
    with styled():
        figure = Figure(figsize=(WIDE, tall))
        figure.text(0.02, 1 - 0.25 / tall, heading, fontsize=10, va="center")
        part = inch * sketch.height / tall
        axes = figure.add_axes((0.01, 1 - 0.45 / tall - part, SHARE, part))
        hide_axes(axes)
        axes.set(xlim=(0, sketch.width), ylim=(sketch.height, 0))
        _draw_sketch(axes, sketch, 72 * inch * sketch.text)
        for i, (name, meaning, value, colour) in enumerate(sketch.legend):
            y = 1 - (0.6 + ROW * i) / tall
            figure.text(SHARE + 0.03, y, name, color=colour or INK, fontsize=9, fontweight="bold")
            lines = [(text, ink) for text, ink in ((meaning, INK), (value, MUTED)) if text]
            for below, (text, ink) in zip((0.16, 0.31), lines, strict=False):  # no gap without a title
                figure.text(SHARE + 0.03, y - below / tall, text, color=ink, fontsize=8)
        figure.savefig(path, dpi=DPI, metadata=file_metadata(path.suffix, description))


def _draw_sketch(axes: "Axes", sketch: Sketch, size: float) -> None:
    """Draw a sketch on axes whose units are the points of its canvas, with text of a size [pt]."""
    for corners, colour in sketch.areas:
        axes.fill(*zip(*corners, strict=True), facecolor=colour + "18", edgecolor=colour + "90", linewidth=0.9)
    for stroke in sketch.strokes:
        across, down = zip(*stroke.points, strict=True)
        dash = (0, (3, 2)) if stroke.style == "dashed" else "-"
        axes.plot(across, down, color=stroke.colour, linewidth=WIDTHS[stroke.style], linestyle=dash)
        if stroke.style == "arrow" and len(stroke.points) > 1:
            head = {
                "arrowstyle": "-|>,head_width=0.22,head_length=0.5",
                "color": stroke.colour,
                "shrinkA": 0,
                "shrinkB": 0,
            }
            axes.annotate("", xy=stroke.points[-1], xytext=stroke.points[-2], arrowprops=head)
    for x, y, colour in sketch.dots:
        axes.plot(x, y, "o", color=colour, markersize=3)
    box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.8}
    for word in sketch.words:
        font: Any = {"fontsize": (0.85 if word.bold else 0.7) * size, "fontweight": "bold" if word.bold else "normal"}
        place: Any = {"ha": "center", "va": "center", "bbox": box, "zorder": 6, "linespacing": 1.1}
        axes.text(word.x, word.y, "\n".join(word.lines), color=word.colour, **font, **place)
