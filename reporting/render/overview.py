"""Figures over all responses: where each lies between its limits, and the goal plot."""

from typing import cast

from reporting import format_numbers
from reporting.analysis import Analysis
from reporting.capability.verdict import CAPABLE, MARGINAL, CapabilityVerdict
from reporting.render.svg import (
    GRID,
    INK,
    MUTED,
    PlotArea,
    axis_x,
    axis_y,
    box,
    dots,
    line,
    marker,
    svg,
    text,
    text_width,
)
from reporting.response import ResponseAnalysis

LIMIT = "#a61c00"
COLOURS = {"capable": "#1f6f43", "marginal": "#8a5a00", "not capable": "#a61c00"}
# The overview shows this much beyond the limits, in half distances between them.
_REACH = 2.0
_ROW = 30.0


def overview_figure(analysis: Analysis) -> str | None:
    """Return the position of every response between its limits, scaled to -1 and +1; None without responses."""
    shown = _two_sided(analysis)
    if not shown:
        return None
    parts = [_scaled(r) for r in shown]
    low = max(min(-1.15, *(p[0] for p in parts), *(p[3] for p in parts)), -_REACH)
    high = min(max(1.15, *(p[2] for p in parts), *(p[4] for p in parts)), _REACH)
    left = min(24 + max(text_width(r.spec.name) for r in shown), 200.0)
    frame = PlotArea(720, 78 + _ROW * len(shown), (low, high), (0, 1), left=left, top=26)
    marks = [
        box(frame.across(-1), frame.top, frame.across(1) - frame.across(-1), frame.ground - frame.top, "#eef3f8"),
        line([(frame.across(0), frame.top), (frame.across(0), frame.ground)], GRID, 1.2),
    ]
    for row, (response, part) in enumerate(zip(shown, parts, strict=True)):
        y = frame.top + _ROW * (row + 0.5)
        colour = verdict_colour(response.verdict)
        start, mean, end, least, largest = (frame.across(min(max(p, low), high)) for p in part)
        marks += [
            box(start, y - 6, end - start, 12, colour, 'fill-opacity="0.55"'),
            line([(least, y), (largest, y)], colour, 1.6),
            dots([(mean, y)], INK, 3),
            text(frame.left - 6, y + 4, response.spec.name, "end"),
        ]
    marks += [marker(frame, at, name, LIMIT, "7 4") for at, name in ((-1.0, "LSL"), (1.0, "USL"))]
    marks.append(axis_x(frame, "position between the limits (0: middle, ±1: limits), each response in its own scale"))
    verdicts = "; ".join(f"{r.spec.name} {_in_words(r)}, Cpk {format_numbers.index(r.capability.cpk)}" for r in shown)
    return svg(frame, f"Position and spread of every response between its limits: {verdicts}.", marks)


def goal_figure(analysis: Analysis) -> str | None:
    """Return offset and spread of every response in units of its tolerance, with lines of Cpk; may be None."""
    shown = _two_sided(analysis)
    if not shown:
        return None
    points = []
    for r in shown:
        lsl, usl, mean, std = cast(tuple[float, ...], (r.spec.lsl, r.spec.usl, r.capability.mean, r.capability.std))
        points.append(((mean - (lsl + usl) / 2) / (usl - lsl), std / (usl - lsl)))
    reach = min(max(0.55, *(1.1 * abs(x) for x, _ in points)), 1.5)
    top = min(max(0.19, *(1.15 * y for _, y in points)), 0.8)
    frame = PlotArea(720, 330, (-reach, reach), (0.0, top), top=14, right=120)
    marks = [axis_y(frame, "σ / (USL − LSL)")]
    for index, colour in ((CAPABLE, COLOURS["capable"]), (MARGINAL, COLOURS["not capable"])):
        peak = 0.5 / (3 * index)
        corners = [(-0.5, 0.0), (0.0, peak), (0.5, 0.0)]
        marks.append(line(((frame.across(x), frame.up(y)) for x, y in corners), colour, 1.6, "7 4"))
        words = text(frame.across(0), frame.up(peak) - 5, f"Cpk {index:.2f}", colour=colour, more='font-weight="600"')
        marks.append(words if peak <= top else "")
    taken: list[tuple[float, float, float]] = []
    for r, (x, y) in zip(shown, points, strict=True):
        at, up = frame.across(min(max(x, -reach), reach)), frame.up(min(y, top))
        marks.append(dots([(at, up)], verdict_colour(r.verdict), 4.5))
        left, baseline = _room(at, up, text_width(r.spec.name), taken)
        marks.append(text(left, baseline, r.spec.name, "start"))
    marks.append(axis_x(frame, "(mean − middle) / (USL − LSL): 0 is centred, ±0.5 on a limit"))
    offsets = "; ".join(
        f"{r.spec.name} offset {x:.3f}, spread {y:.4f}" for r, (x, y) in zip(shown, points, strict=True)
    )
    return svg(frame, f"Goal plot, both in units of the tolerance: {offsets}.", marks)


def _room(at: float, up: float, wide: float, taken: list[tuple[float, float, float]]) -> tuple[float, float]:
    """Return a free position for the name of a dot (right, left, above, below, else lower), and add it to `taken`."""
    row = 13.0
    positions = [(at + 8, up + 4), (at - 8 - wide, up + 4), (at - wide / 2, up - 8), (at - wide / 2, up + 18)]
    positions += [(at + 8, up + 4 + row * i) for i in range(2, 30)]
    left, baseline = next(
        (left, baseline)
        for left, baseline in positions
        if all(abs(baseline - other) >= row or left >= end or start >= left + wide for start, end, other in taken)
    )
    taken.append((left, left + wide, baseline))
    return left, baseline


def verdict_colour(found: CapabilityVerdict) -> str:
    """Return the colour of a verdict; what is not certain is never green."""
    uncertain = found.word == "capable" and not found.certain
    return COLOURS.get("marginal" if uncertain else found.word, MUTED)


def _in_words(response: ResponseAnalysis) -> str:
    """Return the verdict on a response in words."""
    return response.verdict.word + (" (not certain)" if response.verdict.certain is False else "")


def _two_sided(analysis: Analysis) -> list[ResponseAnalysis]:
    """Return the responses with both limits and a spread."""
    return [r for r in analysis.responses if r.capability.cp is not None]


def _scaled(response: ResponseAnalysis) -> tuple[float, float, float, float, float]:
    """Return mean less three sigma, mean, mean plus three sigma, minimum and maximum, limits at -1 and +1."""
    spec, c = response.spec, response.capability
    lsl, usl, mean, std, low, high = cast(tuple[float, ...], (spec.lsl, spec.usl, c.mean, c.std, c.min, c.max))
    middle, half = (lsl + usl) / 2, (usl - lsl) / 2
    first, second, third, fourth, fifth = (
        (value - middle) / half for value in (mean - 3 * std, mean, mean + 3 * std, low, high)
    )
    return first, second, third, fourth, fifth
