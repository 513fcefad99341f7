"""The goal plot: centring and spread of every response in units of its tolerance."""

import math
from typing import cast

from reporting.analysis import Analysis
from reporting.capability.verdict import CAPABLE, MARGINAL
from reporting.render.axes import HALF
from reporting.render.overview import COLOURS, in_overview, verdict_colour
from reporting.render.svg import (
    MUTED,
    SIZE,
    PlotArea,
    axis_x,
    axis_y,
    box,
    dots,
    line,
    shortened,
    svg,
    text,
    text_width,
)
from reporting.response import ResponseAnalysis

Box = tuple[float, float, float, float]  # left, top, right, bottom

_DOT = 4.5
_LONGEST = 130.0  # largest width of a name
_DIRECTIONS, _RINGS, _RING = 24, 40, 9.0  # candidate positions of a name: rings around its dot


def goal_figure(analysis: Analysis) -> str | None:
    """Return the figure of offset and spread of every response in units of its tolerance, with Cpk lines; or None."""
    shown = [r for r in in_overview(analysis) if r.capability.cp is not None]
    if not shown:
        return None
    points = [_offset_and_spread(r) for r in shown]
    reach = min(max(0.55, *(1.1 * abs(x) for x, _ in points)), 1.5)
    top = min(max(0.19, *(1.15 * y for _, y in points)), 0.8)
    frame = PlotArea(HALF, 330, (-reach, reach), (0.0, top), top=14)
    marks, taken = [axis_y(frame, "σ / (USL − LSL)")], list[Box]()
    for index, colour in ((CAPABLE, COLOURS["capable"]), (MARGINAL, COLOURS["not capable"])):
        peak = 0.5 / (3 * index)
        corners = [(-0.5, 0.0), (0.0, peak), (0.5, 0.0)]
        marks.append(line(((frame.across(x), frame.up(y)) for x, y in corners), colour, 1.6, "7 4"))
        if peak <= top:
            words = f"Cpk {index:.2f}"
            marks.append(text(frame.across(0), frame.up(peak) - 5, words, colour=colour, more='font-weight="600"'))
            taken.append(_box_of(words, frame.across(0), frame.up(peak) - 9))
    places = [(frame.across(min(max(x, -reach), reach)), frame.up(min(y, top))) for x, y in points]
    taken += [(x - _DOT, y - _DOT, x + _DOT, y + _DOT) for x, y in places]
    named = []
    for r, (x, y) in zip(shown, places, strict=True):
        named += _named(shortened(r.spec.name, _LONGEST), x, y, frame, taken)
        marks.append(dots([(x, y)], verdict_colour(r.verdict), _DOT))
    marks += [*named, axis_x(frame, "(mean − middle) / (USL − LSL)")]
    offsets = "; ".join(
        f"{r.spec.name} offset {x:.3f}, spread {y:.4f}" for r, (x, y) in zip(shown, points, strict=True)
    )
    return svg(frame, f"Goal plot, both in units of the tolerance: {offsets}.", marks)


def _offset_and_spread(response: ResponseAnalysis) -> tuple[float, float]:
    """Return the offset of the mean from the middle, and sigma, both in units of the tolerance."""
    spec, c = response.spec, response.capability
    lsl, usl, mean, std = cast(tuple[float, ...], (spec.lsl, spec.usl, c.mean, c.std))
    return (mean - (lsl + usl) / 2) / (usl - lsl), std / (usl - lsl)


def _named(name: str, x: float, y: float, frame: PlotArea, taken: list[Box]) -> list[str]:
    """Return the name of a dot at a free position, with a line to the dot if it is far; add its box to `taken`.

    If there is no room the name is left out; the description of the figure contains it.
    """
    for ring in range(_RINGS):
        for i in range(_DIRECTIONS):
            turn = 2 * math.pi * i / _DIRECTIONS
            across, down = math.cos(turn), math.sin(turn)
            wide, tall = 0.5 * text_width(name) + 2, 0.5 * SIZE + 2
            reach = min(wide / max(abs(across), 1e-9), tall / max(abs(down), 1e-9)) + _DOT + 2 + _RING * ring
            middle, height = x + reach * across, y + reach * down
            found = _box_of(name, middle, height)
            if _is_free(found, frame, taken):
                taken.append(found)
                leader = [
                    line([(x, y), (min(max(x, found[0]), found[2]), min(max(y, found[1]), found[3]))], MUTED, 0.7)
                ]
                ground = box(
                    found[0], found[1], found[2] - found[0], found[3] - found[1], "white", 'fill-opacity="0.8"'
                )
                return [*(leader if ring else []), ground, text(middle, height + 0.35 * SIZE, name)]
    return []


def _box_of(words: str, middle: float, height: float) -> Box:
    """Return the rectangle that a text occupies."""
    wide, tall = 0.5 * text_width(words) + 2, 0.5 * SIZE + 1
    return middle - wide, height - tall, middle + wide, height + tall


def _is_free(found: Box, frame: PlotArea, taken: list[Box]) -> bool:
    """Return whether a rectangle lies in the plot and overlaps no other one."""
    left, top, right, bottom = found
    if left < frame.left or right > frame.width or top < 0 or bottom > frame.ground:
        return False
    return all(right <= a or c <= left or bottom <= b or d <= top for a, b, c, d in taken)
