"""The figure of a histogram before and after a change, as coordinates for an SVG."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

WIDTH, HEIGHT = 320.0, 110.0  # size of the drawing, in its own units


@dataclass(frozen=True)
class Figure:
    """The drawing of a histogram."""

    # (x, y, width, height); heights are counts divided by bin widths, so that areas are proportional to counts.
    bars: list[tuple[float, float, float, float]]
    after: str  # points of the outline under the new distributions; empty without them
    limits: list[tuple[float, str]]  # places and names of the limits within the drawing
    lower: float  # left end of the axis, in the unit of the response
    upper: float  # right end


def histogram_figure(bins: Mapping[str, Any]) -> Figure | None:
    """Return the figure of the bins of a response; None if it has no values."""
    edges = bins["edges"]
    if len(edges) < 2 or not edges[-1] > edges[0]:
        return None
    before = _heights(edges, bins["before"])
    after = _heights(edges, bins["after"]) if bins["after"] else []
    scale = HEIGHT / (max([*before, *after]) or 1.0)

    def x_of(value: float) -> float:
        return round(float(WIDTH * (value - edges[0]) / (edges[-1] - edges[0])), 2)

    bars = [
        (
            x_of(edges[i]),
            round(HEIGHT - h * scale, 2),
            round(x_of(edges[i + 1]) - x_of(edges[i]), 2),
            round(h * scale, 2),
        )
        for i, h in enumerate(before)
    ]
    corners = [(0.0, HEIGHT)]
    for i, h in enumerate(after):
        y = round(HEIGHT - h * scale, 2)
        corners += [(x_of(edges[i]), y), (x_of(edges[i + 1]), y)]
    outline = " ".join(f"{x:g},{y:g}" for x, y in [*corners, (WIDTH, HEIGHT)]) if after else ""
    limits = [
        (x_of(bins[key]), words)
        for key, words in (("lsl", "lower limit"), ("usl", "upper limit"))
        if bins[key] is not None and edges[0] <= bins[key] <= edges[-1]
    ]
    return Figure(bars, outline, limits, edges[0], edges[-1])


def _heights(edges: Sequence[float], counts: Sequence[float]) -> list[float]:
    """Return counts divided by the widths of their bins."""
    return [c / (b - a) if b > a else 0.0 for c, a, b in zip(counts, edges, edges[1:], strict=False)]
