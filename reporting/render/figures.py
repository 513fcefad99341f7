"""Figures of one response besides its histogram: probability plot, convergence, tornado, with descriptions in words."""

import math

import numpy as np
from scipy.special import ndtri

from reporting import format_numbers
from reporting.capability.verdict import CAPABLE, FEWEST_FOR_A_VERDICT, MARGINAL
from reporting.render.axes import HALF, LIMIT, TALL, around, axis_name
from reporting.render.inset import inset, inset_area, is_sliver
from reporting.render.svg import (
    INK,
    MUTED,
    PlotArea,
    axis_x,
    axis_y,
    band,
    box,
    curve,
    dots,
    line,
    marker,
    shortened,
    svg,
    text,
    text_width,
    y_room,
)
from reporting.response import ResponseAnalysis

_BARS = 15  # of a tornado; the table beside it has all variables
_PROBABILITIES = (0.0001, 0.001, 0.01, 0.1, 0.5, 0.9, 0.99, 0.999, 0.9999)


def probability_figure(response: ResponseAnalysis) -> str | None:
    """Return the normal probability plot with its band; None without one."""
    plot, spec, c = response.plot, response.spec, response.capability
    if plot is None or c.mean is None or not c.std:
        return None
    limits = [v for v in (spec.lsl, spec.usl) if v is not None]
    scores = np.asarray(plot.scores)
    reach = max(3.1, float(np.max(np.abs(scores))) + 0.2)
    fit = [c.mean - reach * c.std, c.mean + reach * c.std]
    frame = PlotArea(HALF, TALL, around([*limits, *plot.values, *fit]), (-reach, reach), left=76, top=28)
    ticks = [(float(ndtri(p)), f"{100 * p:g}") for p in _PROBABILITIES if abs(ndtri(p)) < reach]
    marks = [
        axis_y(frame, "values below [%]", ticks),
        line([(frame.across(fit[0]), frame.up(-reach)), (frame.across(fit[1]), frame.up(reach))], INK, 1.3),
        *(curve(frame, side, plot.scores, MUTED, "4 3") for side in (plot.low, plot.high)),
        dots(((frame.across(v), frame.up(s)) for v, s in zip(plot.values, plot.scores, strict=True)), "#1b5f9e", 1.8),
        axis_x(frame, axis_name(spec.name, spec.unit)),
        *(
            marker(frame, v, f"{name} {format_numbers.plain(v)}", LIMIT, "7 4")
            for v, name in ((spec.lsl, "LSL"), (spec.usl, "USL"))
            if v is not None
        ),
    ]
    ends = min(plot.values), max(plot.values)
    if is_sliver(*ends, frame):
        area = inset_area(frame, around([*ends]), frame.y, limits)
        points = ((area.across(v), area.up(s)) for v, s in zip(plot.values, plot.scores, strict=True))
        reached = [(x, (x - c.mean) / c.std) for x in area.x]
        low, high = (min(max(z, -reach), reach) for _, z in reached)
        straight = [(area.across(c.mean + z * c.std), area.up(z)) for z in (low, high)]
        marks.append(inset(area, [line(straight, INK, 1.3), dots(points, "#1b5f9e", 1.8)]))
    label = f"Normal probability plot of {spec.name}, a straight line if it is normal. {response.normality.reason}"
    return svg(frame, label, marks)


def convergence_figure(response: ResponseAnalysis) -> str | None:
    """Return the index against the number of samples with its band; None without one."""
    run, spec = response.running, response.spec
    if run is None:
        return None
    # The wide band of the first few values would flatten the rest of the figure.
    first = next((i for i, count in enumerate(run.n) if count >= FEWEST_FOR_A_VERDICT), 0)
    bars = [CAPABLE, MARGINAL] if run.index == "Cpk" else []
    low, high = min(run.low[first:]), max(run.high[first:])
    near = [bar for bar in bars if low - 0.5 * (high - low) <= bar <= high + 0.5 * (high - low)]
    # An axis must not be empty if there is only one point.
    x, y = (math.log10(run.n[first]), math.log10(run.n[-1]) + 1e-9), around([low, high, *near])
    frame = PlotArea(HALF, TALL, x, y, left=y_room(*y), top=28)
    n = [math.log10(count) for count in run.n[first:]]
    powers = [10**p for p in range(1, 9) if run.n[first] <= 10**p <= run.n[-1]]
    if len(powers) < 3:
        powers = [k * 10**p for p in range(1, 9) for k in (1, 2, 5) if run.n[first] <= k * 10**p <= run.n[-1]]
    ticks = [(math.log10(p), f"{p:,}".replace(",", "\u202f")) for p in powers]
    unit = spec.unit if run.index == "mean" else "1"
    marks = [
        axis_y(frame, axis_name(f"{run.index}", unit)),
        band(frame, n, run.low[first:], run.high[first:], "#cfdeee"),
        curve(frame, n, run.value[first:], "#1b5f9e"),
        *(line([(frame.left, frame.up(b)), (frame.width - frame.right, frame.up(b))], LIMIT, 1.2, "7 4") for b in near),
        *(text(frame.width - frame.right - 2, frame.up(b) - 4, f"{b:.2f}", "end", LIMIT) for b in near),
        axis_x(frame, "samples", ticks),
    ]
    label = (
        f"{run.index} of {spec.name} over the first samples: {format_numbers.significant(run.value[-1], 4)}, "
        f"{format_numbers.significant(run.low[-1], 4)} to {format_numbers.significant(run.high[-1], 4)}, "
        f"after {run.n[-1]}."
    )
    return svg(frame, label, marks)


def tornado_figure(response: ResponseAnalysis) -> str | None:
    """Return a tornado chart of the effect of each variable on the expected response; None without a sensitivity."""
    influences = response.sensitivity.ranked if response.sensitivity else ()
    shown = [i for i in influences if i.low is not None and i.high is not None][:_BARS]
    c, spec = response.capability, response.spec
    if not shown or c.mean is None:
        return None
    lows, highs = [i.low or 0.0 for i in shown], [i.high or 0.0 for i in shown]
    height = 62.0 + 22 * len(shown)
    left = min(16 + max(text_width(i.variable) for i in shown), 170.0)
    frame = PlotArea(HALF, height, around([*lows, *highs, c.mean]), (0, len(shown)), left=left, top=8)
    marks = []
    for row, (influence, low, high) in enumerate(zip(shown, lows, highs, strict=True)):
        y = frame.top + 22 * row
        x, end = frame.across(low), frame.across(high)
        colour = "#1b5f9e" if influence.verdict == "critical" else "#9db4cb"
        marks += [
            box(x, y + 3, max(end - x, 0.8), 15, colour),
            text(frame.left - 6, y + 15, shortened(influence.variable, left - 8), "end"),
        ]
    middle = frame.across(c.mean)
    marks.append(line([(middle, frame.top), (middle, frame.ground)], INK, 1, "3 3"))
    marks.append(axis_x(frame, f"expected {axis_name(spec.name, spec.unit)}"))
    ranges = "; ".join(
        f"{i.variable} {format_numbers.significant(i.low)} to {format_numbers.significant(i.high)}" for i in shown
    )
    label = f"Tornado of {spec.name}: expected value with each variable from its 5th to its 95th percentile: {ranges}."
    return svg(frame, label, marks)
