"""Histograms of responses as places in a drawing, with an axis and the limits; style sheets colour them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from reporting import format_numbers
from reporting.render.svg import around, labelled, with_near

WIDTH, HEIGHT = 260.0, 132.0  # of the drawing, in its own units, which are pixels in a card of usual width
TOP, GROUND = 18.0, 112.0  # above are the names of the limits, below the numbers of the axis
LETTER = 7.4  # width of a letter, on average, of a name in bold
TICKS = (4, 6, 8)  # round numbers on the axis, about: more where fewer than two of them have room


@dataclass(frozen=True)
class Limit:
    """A limit in a histogram."""

    x: float | None  # of its line; None if it is far from the values
    middle: float  # of its name
    words: str


@dataclass(frozen=True)
class Figure:
    """The drawing of a histogram; heights are counts divided by widths, so that areas are proportional to counts."""

    bars: list[tuple[float, float, float, float]]  # x, y, width, height
    after: str  # points of the outline under the new distributions; empty without them
    limits: list[Limit]
    ticks: list[tuple[float, str]]
    width: float = WIDTH
    height: float = HEIGHT
    ground: float = GROUND
    top: float = TOP


def histogram_figure(bins: Mapping[str, Any]) -> Figure | None:
    """Return the figure of the `Bins` of a response; None if it has no values.

    A limit far from the values is named at the edge, with an arrow.
    """
    edges = bins["edges"]
    if len(edges) < 2 or not edges[-1] > edges[0]:
        return None
    limits = [(name, bins[key]) for name, key in (("LSL", "lsl"), ("USL", "usl")) if bins[key] is not None]
    shown, far = with_near([edges[0], edges[-1]], [value for _, value in limits])
    low, high = around(shown)

    def across(value: float) -> float:
        return round(WIDTH * (value - low) / (high - low), 2)

    before, after = _heights(edges, bins["before"]), _heights(edges, bins["after"] or ())
    scale = (GROUND - TOP) / (max([*before, *after]) or 1.0)
    x = [across(edge) for edge in edges]
    bars = [
        (left, round(GROUND - tall * scale, 2), round(right - left, 2), round(tall * scale, 2))
        for left, right, tall in zip(x, x[1:], before, strict=False)
    ]
    corners = [(x[0], GROUND)]
    for left, right, tall in zip(x, x[1:], after, strict=False):
        y = round(GROUND - tall * scale, 2)
        corners += [(left, y), (right, y)]
    outline = " ".join(f"{a:g},{b:g}" for a, b in [*corners, (x[-1], GROUND)]) if after else ""
    placed = [(None if value in far else across(value), name, value) for name, value in limits]
    kept: list[tuple[float, str]] = []
    for count in TICKS:
        if len(kept) < 2:
            kept = [(across(value), words) for value, words in labelled(low, high, count)]
            kept = [(at, words) for at, words in kept if abs(at - 0.5 * WIDTH) <= 0.5 * (WIDTH - LETTER * len(words))]
            while len(kept) > 1 and sum(LETTER * len(words) + 8 for _, words in kept) > WIDTH:
                kept = kept[::2]
    return Figure(bars, outline, _named(placed, edges[0]), kept)


def _named(limits: Sequence[tuple[float | None, str, float]], least: float) -> list[Limit]:
    """Return limits, given as x, name and value, with names that keep off each other and off the edges."""
    found = []
    for x, name, value in limits:
        words = f"{name} {format_numbers.plain(value)}"
        if x is None:
            words = f"← {words}" if value < least else f"{words} →"
        half = 0.5 * LETTER * len(words)
        wanted = x if x is not None else 0.0 if value < least else WIDTH
        found.append((min(max(wanted, half), WIDTH - half), half, x, words))
    found.sort(key=lambda each: each[0])
    if len(found) == 2:
        (first, half, *_), (second, other, *_) = found
        lack = max(half + other + 4 - (second - first), 0.0)
        right = min(second + 0.5 * lack, WIDTH - other)
        left = max(min(first, right - half - other - 4), half)
        right = max(right, left + half + other + 4)
        found = [(left, *found[0][1:]), (right, *found[1][1:])]
    return [Limit(x, round(middle, 1), words) for middle, _, x, words in found]


def _heights(edges: Sequence[float], counts: Sequence[float]) -> list[float]:
    """Return counts divided by the widths of their bins."""
    return [c / (b - a) if b > a else 0.0 for c, a, b in zip(counts, edges, edges[1:], strict=False)]
