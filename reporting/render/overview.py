"""A figure of all responses: the position of each between its limits."""

from reporting import format_numbers
from reporting.analysis import Analysis
from reporting.capability.verdict import CapabilityVerdict
from reporting.render.axes import HALF, LIMIT
from reporting.render.svg import (
    GRID,
    INK,
    MUTED,
    PlotArea,
    axis_x,
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

COLOURS = {"capable": "#1f6f43", "marginal": "#8a5a00", "not capable": "#a61c00"}
# Range shown beyond the limits, in half distances between them.
_REACH = 2.0
_ROW = 30.0
_ONE_SIDED = 4.0  # sigmas that replace half the distance between the limits: 0 is then Cpk 1.33


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
            box(first, frame.top + _ROW * row, last - first, _ROW, "#eef3f8"),
            box(start, y - 6, end - start, 12, colour, 'fill-opacity="0.55"'),
            line([(least, y), (largest, y)], colour, 1.6),
            dots([(mean, y)], INK, 3),
            text(frame.left - 6, y + 4, shortened(_marked(response), left - 8), "end"),
        ]
    marks += [marker(frame, at, name, LIMIT, "7 4") for at, name in ((-1.0, "LSL"), (1.0, "USL"))]
    marks.append(axis_x(frame, "position: 0 in the middle, ±1 on a limit"))
    verdicts = "; ".join(f"{r.spec.name} {_in_words(r)}, Cpk {format_numbers.index(r.capability.cpk)}" for r in shown)
    return svg(frame, f"Position and spread of every response between its limits: {verdicts}.", marks)


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


def _marked(response: ResponseAnalysis) -> str:
    """Return the name of a response, with a star if it has one limit."""
    return response.spec.name + (" *" if response.capability.cp is None else "")


def verdict_colour(found: CapabilityVerdict) -> str:
    """Return the colour of a verdict; an uncertain verdict is never green."""
    uncertain = found.word == "capable" and not found.certain
    return COLOURS.get("marginal" if uncertain else found.word, MUTED)


def _in_words(response: ResponseAnalysis) -> str:
    """Return the verdict on a response in words."""
    return response.verdict.word + (" (not certain)" if response.verdict.certain is False else "")


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
