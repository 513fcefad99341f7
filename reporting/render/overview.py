"""Figures of all responses: the position of each between its limits, and the goal plot of centring and spread."""

import math
from typing import cast

from reporting import format_numbers
from reporting.analysis import Analysis
from reporting.capability.verdict import CAPABLE, MARGINAL, CapabilityVerdict
from reporting.render.svg import (
    AMBER,
    BETWEEN,
    GRID,
    HALF,
    INK,
    LIMIT,
    MUTED,
    PAPER,
    SIZE,
    TARGET,
    PlotArea,
    axis_x,
    axis_y,
    box,
    dots,
    line,
    marker,
    shortened,
    svg,
    text,
    text_width,
)
from reporting.response import ResponseAnalysis

COLOURS = {"capable": TARGET, "marginal": AMBER, "not capable": LIMIT}
# Range shown beyond the limits, in half distances between them.
_REACH = 2.0
_ROW = 30.0
_ONE_SIDED = 4.0  # sigmas that replace half the distance between the limits: 0 is then Cpk 1.33
Box = tuple[float, float, float, float]  # left, top, right, bottom

_DOT = 4.5
_LONGEST = 130.0  # largest width of a name in the goal plot
_DIRECTIONS, _RINGS, _RING = 24, 40, 9.0  # candidate positions of a name: rings around its dot


def overview_figure(analysis: Analysis) -> str | None:
    """Return the position of every response between its limits, scaled to -1 and +1; None without responses."""
    shown = in_overview(analysis)
    if not shown:
        return None
    parts = [_scaled(r) for r in shown]
    low = max(min(-1.15, *(p[0] for p in parts), *(p[3] for p in parts)), -_REACH)
    high = min(max(1.15, *(p[2] for p in parts), *(p[4] for p in parts)), _REACH)
    left = min(24 + max(text_width(_marked(r)) for r in shown), 150.0)
    frame = PlotArea(HALF, 78 + _ROW * len(shown), (low, high), (0, 1), left=left, top=26)
    marks = [line([(frame.across(0), frame.top), (frame.across(0), frame.ground)], GRID, 1.2)]
    for row, (response, part) in enumerate(zip(shown, parts, strict=True)):
        y, spec = frame.top + _ROW * (row + 0.5), response.spec
        colour = verdict_colour(response.verdict)
        start, mean, end, least, largest = (frame.across(min(max(p, low), high)) for p in part)
        first = frame.across(low if spec.lsl is None else -1)
        last = frame.across(high if spec.usl is None else 1)
        marks += [
            box(first, frame.top + _ROW * row, last - first, _ROW, BETWEEN),
            box(start, y - 6, end - start, 12, colour, 'fill-opacity="0.55"'),
            line([(least, y), (largest, y)], colour, 1.6),
            dots([(mean, y)], INK, 3),
            text(frame.left - 6, y + 4, shortened(_marked(response), left - 8), "end"),
        ]
    marks += [marker(frame, at, name, LIMIT, "7 4") for at, name in ((-1.0, "LSL"), (1.0, "USL"))]
    marks.append(axis_x(frame, "position: 0 in the middle, ±1 on a limit"))
    verdicts = "; ".join(f"{r.spec.name} {_in_words(r)}, Cpk {format_numbers.index(r.capability.cpk)}" for r in shown)
    return svg(frame, f"Position and spread of every response between its limits: {verdicts}.", marks)


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
    for row, (index, colour) in enumerate(((MARGINAL, COLOURS["not capable"]), (CAPABLE, COLOURS["capable"]))):
        peak = 0.5 / (3 * index)
        corners = [(-0.5, 0.0), (0.0, peak), (0.5, 0.0)]
        marks.append(line(((frame.across(x), frame.up(y)) for x, y in corners), colour, 1.6, "7 4"))
        # A key in the corner: beside the lines there may be no room between them.
        words, height = f"Cpk {index:.2f}", frame.top + 12 + 18 * row
        start = frame.left + 36
        marks.append(line([(frame.left + 4, height - 4), (start - 6, height - 4)], colour, 1.6, "7 4"))
        marks.append(text(start, height, words, "start", colour, 'font-weight="600"'))
        taken.append((frame.left, height - SIZE, start + text_width(words) + 6, height + 4))
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


def in_overview(analysis: Analysis) -> list[ResponseAnalysis]:
    """Return the responses with a limit and a spread."""
    return [r for r in analysis.responses if r.capability.cpk is not None and r.capability.std]


def one_sided(analysis: Analysis) -> list[ResponseAnalysis]:
    """Return the responses with a spread and one limit."""
    return [r for r in in_overview(analysis) if r.capability.cp is None]


def out_of_figures(analysis: Analysis) -> list[ResponseAnalysis]:
    """Return the responses with limits that no overview figure can show: those without values or spread."""
    limited = [r for r in analysis.responses if r.spec.lsl is not None or r.spec.usl is not None]
    return [r for r in limited if r not in in_overview(analysis)]


def verdict_colour(found: CapabilityVerdict) -> str:
    """Return the colour of a verdict; an uncertain verdict is never green."""
    uncertain = found.word == "capable" and not found.certain
    return COLOURS.get("marginal" if uncertain else found.word, MUTED)


def _scaled(response: ResponseAnalysis) -> tuple[float, float, float, float, float]:
    """Return mean - 3 sigma, mean, mean + 3 sigma, minimum and maximum, scaled so that limits are at -1 and +1."""
    spec, c = response.spec, response.capability
    mean, std = c.mean or 0.0, c.std or 0.0
    if spec.lsl is not None and spec.usl is not None:
        middle, half = (spec.lsl + spec.usl) / 2, (spec.usl - spec.lsl) / 2
    else:
        half = _ONE_SIDED * std
        middle = (spec.usl or 0.0) - half if spec.lsl is None else spec.lsl + half
    values = (mean - 3 * std, mean, mean + 3 * std, mean if c.min is None else c.min, mean if c.max is None else c.max)
    first, second, third, fourth, fifth = ((value - middle) / half for value in values)
    return first, second, third, fourth, fifth


def _marked(response: ResponseAnalysis) -> str:
    """Return the name of a response, with a star if it has one limit."""
    return response.spec.name + (" *" if response.capability.cp is None else "")


def _in_words(response: ResponseAnalysis) -> str:
    """Return the verdict on a response in words."""
    return response.verdict.word + (" (not certain)" if response.verdict.certain is False else "")


def _offset_and_spread(response: ResponseAnalysis) -> tuple[float, float]:
    """Return the offset of the mean from the middle, and sigma, both in units of the tolerance."""
    spec, c = response.spec, response.capability
    lsl, usl, mean, std = cast(tuple[float, ...], (spec.lsl, spec.usl, c.mean, c.std))
    return (mean - (lsl + usl) / 2) / (usl - lsl), std / (usl - lsl)


def _named(name: str, x: float, y: float, frame: PlotArea, taken: list[Box]) -> list[str]:
    """Return the name of a dot at a free position, with a line to the dot if it is far; add its box to `taken`."""
    # If there is no room the name is left out; the description of the figure contains it.
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
                ground = box(found[0], found[1], found[2] - found[0], found[3] - found[1], PAPER, 'fill-opacity="0.8"')
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
