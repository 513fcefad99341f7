"""Figures of the report, as SVG with a description in words.

Of one response: histogram, normal probability plot, convergence, tornado, and scatter against its strongest inputs; the
histograms of an input and of a response in two campaigns; the mechanism and what its responses measure.
`reporting.render.panels` shows all responses at once.
"""

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import ndtri

from reporting import format_numbers
from reporting.arrays import Array
from reporting.capability.verdict import CAPABLE, FEWEST_FOR_A_VERDICT, MARGINAL
from reporting.comparison import ResponseComparison
from reporting.inputs import VariableAnalysis
from reporting.render import svg
from reporting.response import ResponseAnalysis
from reporting.sensitivity.scatter import Scatter
from reporting.shape.fitting import distribution
from reporting.shape.histogram import Histogram
from reporting.spec import DrawnLine, DrawnWords, MechanismDrawing

# Distance of the hatch lines of a bar; an SVG pattern would need an id that is unique on the page.
_HATCH = 5.0
_BARS = 15  # of a tornado; the table beside it has all variables
PROBABILITIES = (0.0001, 0.001, 0.01, 0.1, 0.5, 0.9, 0.99, 0.999, 0.9999)


def response_figure(response: ResponseAnalysis) -> str:
    """Return the histogram of a response with its limits, the normal density and the fitted density."""
    spec, c, bins = response.spec, response.capability, response.histogram
    limits = [value for value in (spec.lsl, spec.usl) if value is not None]
    fences = [*limits, *([] if spec.target is None else [spec.target])]
    ends = [*fences, *((bins.edges[0], bins.edges[-1]) if bins else ())]
    curves: list[tuple[Array, Array, str, str]] = []
    if c.mean is not None and c.std:
        x = np.linspace(c.mean - 4.5 * c.std, c.mean + 4.5 * c.std, 121)
        curves.append((x, np.exp(-(((x - c.mean) / c.std) ** 2) / 2) / (c.std * math.sqrt(2 * math.pi)), svg.INK, ""))
        best = response.fits.of(response.fits.best)
        if best is not None and best.family != "normal":
            with np.errstate(all="ignore"):
                density = np.exp(distribution(best).logpdf(x))
            kept = np.isfinite(density)
            curves.append((x[kept], density[kept], svg.FIT, "5 3"))
    most = max([float(np.max(density_bars(bins)[1])) if bins else 0.0, *(_top(y) for _, y, _, _ in curves)])
    y = (0.0, 1.06 * most or 1.0)
    frame = svg.PlotArea(svg.HALF, svg.TALL, svg.around(ends or [0.0]), y, left=svg.y_room(*y), top=42)
    marks = [svg.axis_y(frame, svg.density_name(spec.unit))]
    marks += [_bars(frame, bins, spec.lsl, spec.usl)] if bins else []
    marks += _curves(frame, curves)
    marks.append(svg.axis_x(frame, svg.axis_name(spec.name, spec.unit)))
    marks += svg.limit_markers(frame, ((spec.lsl, "LSL"), (spec.usl, "USL")))
    if spec.target is not None:
        marks.append(
            svg.marker(frame, spec.target, f"target {format_numbers.plain(spec.target)}", svg.TARGET, "2 3", 1)
        )
    is_off = (spec.lsl is not None and (c.mean or 0.0) < spec.lsl) or (
        spec.usl is not None and (c.mean or 0.0) > spec.usl
    )
    least = svg.OFF if is_off else svg.SLIVER
    if bins is not None and c.min is not None and c.max is not None and svg.is_sliver(c.min, c.max, frame, least):
        area = svg.inset_area(frame, svg.around([c.min, c.max]), frame.y, limits)
        marks.append(svg.inset(area, [_bars(area, bins, spec.lsl, spec.usl), *_curves(area, curves)]))
    return svg.figure(frame, response_label(response), marks)


def variable_figure(variable: VariableAnalysis) -> str:
    """Return the histogram of an input with the requested density."""
    spec, bins = variable.spec, variable.histogram
    points = np.asarray(spec.density, dtype=float).reshape(-1, 2)
    ends = [*((bins.edges[0], bins.edges[-1]) if bins else ()), *points[:, 0].tolist()]
    most = max(float(np.max(density_bars(bins)[1])) if bins else 0.0, _top(points[:, 1]))
    y = (0.0, 1.06 * most or 1.0)
    frame = svg.PlotArea(340, 210, svg.around(ends or [0.0]), y, left=svg.y_room(*y), top=12)
    marks = [svg.axis_y(frame, svg.density_name(spec.unit))]
    marks += [_bars(frame, bins, spec.lower, spec.upper)] if bins else []
    if points.size:
        seen = points[points[:, 1] <= frame.y[1]]
        marks.append(svg.curve(frame, seen[:, 0].tolist(), seen[:, 1].tolist()))
    marks.append(svg.axis_x(frame, svg.axis_name(spec.name, spec.unit)))
    label = f"Histogram of input {spec.name}: {variable.n} values; requested {spec.distribution}."
    return svg.figure(frame, label, marks)


def compared_figure(comparison: ResponseComparison) -> str | None:
    """Return the histograms of a response in both campaigns; None if one has no values."""
    bins, other = comparison.histogram, comparison.histogram_other
    if bins is None or other is None:
        return None
    limits = [v for v in (comparison.capability.lsl, comparison.capability.usl) if v is not None]
    most = max(float(np.max(density_bars(b)[1])) for b in (bins, other))
    x, y = svg.around([*limits, bins.edges[0], bins.edges[-1]]), (0.0, 1.06 * most)
    frame = svg.PlotArea(svg.HALF, svg.TALL, x, y, left=svg.y_room(*y), top=28)
    marks = [svg.axis_y(frame, svg.density_name(comparison.unit)), _bars(frame, bins, None, None)]
    edges, heights = density_bars(other)
    steps = [(edges[0], 0.0)]
    for left, right, height in zip(edges[:-1], edges[1:], heights, strict=True):
        steps += [(left, height), (right, height)]
    steps.append((edges[-1], 0.0))
    marks.append(svg.line(((frame.across(x), frame.up(y)) for x, y in steps), svg.OTHER, 2))
    marks.append(svg.axis_x(frame, svg.axis_name(comparison.response, comparison.unit)))
    marks += svg.limit_markers(frame, ((comparison.capability.lsl, "LSL"), (comparison.capability.usl, "USL")))
    mean, other_mean = (c.mean for c in (comparison.capability, comparison.capability_other))
    label = (
        f"{comparison.response} in both campaigns: bars, {comparison.n} values of this campaign with mean "
        f"{format_numbers.significant(mean, 4)}; line, {comparison.n_other} values of the other campaign with mean "
        f"{format_numbers.significant(other_mean, 4)}."
    )
    return svg.figure(frame, label, marks)


def response_label(response: ResponseAnalysis) -> str:
    """Return a description of the histogram of a response."""
    spec, c = response.spec, response.capability
    unit = svg.unit_suffix(spec.unit)
    if c.n == 0:
        return f"Histogram of {spec.name}: no values."
    fences, places = (spec.lsl, spec.usl), format_numbers.decimals_for(c.std)
    low, high = format_numbers.fixed(c.min, places, fences), format_numbers.fixed(c.max, places, fences)
    words = f"Histogram of {spec.name}: {c.n} values from {low} to {high}{unit}"
    limits = [
        f"{name} {format_numbers.plain(value)}{unit}"
        for name, value in (("lower limit", spec.lsl), ("upper limit", spec.usl), ("target", spec.target))
        if value is not None
    ]
    rejects = (c.below or 0) + (c.above or 0)
    limits += [f"{rejects} values out of limits"] if c.ppm_observed is not None else ["no limits"]
    return f"{words}; {', '.join(limits)}."


def probability_figure(response: ResponseAnalysis) -> str | None:
    """Return the normal probability plot with its band; None without one."""
    plot, spec, c = response.plot, response.spec, response.capability
    if plot is None or c.mean is None or not c.std:
        return None
    limits = [v for v in (spec.lsl, spec.usl) if v is not None]
    scores = np.asarray(plot.scores)
    reach = max(3.1, float(np.max(np.abs(scores))) + 0.2)
    fit = [c.mean - reach * c.std, c.mean + reach * c.std]
    frame = svg.PlotArea(
        svg.HALF, svg.TALL, svg.around([*limits, *plot.values, *fit]), (-reach, reach), left=76, top=28
    )
    marks = [
        svg.axis_y(frame, "values below [%]", tick_scores(PROBABILITIES, reach)),
        svg.line([(frame.across(fit[0]), frame.up(-reach)), (frame.across(fit[1]), frame.up(reach))], svg.INK, 1.3),
        *(svg.curve(frame, side, plot.scores, svg.MUTED, "4 3") for side in (plot.low, plot.high)),
        svg.dots(
            ((frame.across(v), frame.up(s)) for v, s in zip(plot.values, plot.scores, strict=True)), svg.DEEP, 1.8
        ),
        svg.axis_x(frame, svg.axis_name(spec.name, spec.unit)),
        *svg.limit_markers(frame, ((spec.lsl, "LSL"), (spec.usl, "USL"))),
    ]
    ends = min(plot.values), max(plot.values)
    if svg.is_sliver(*ends, frame):
        area = svg.inset_area(frame, svg.around([*ends]), frame.y, limits)
        points = ((area.across(v), area.up(s)) for v, s in zip(plot.values, plot.scores, strict=True))
        reached = [(x, (x - c.mean) / c.std) for x in area.x]
        low, high = (min(max(z, -reach), reach) for _, z in reached)
        straight = [(area.across(c.mean + z * c.std), area.up(z)) for z in (low, high)]
        marks.append(svg.inset(area, [svg.line(straight, svg.INK, 1.3), svg.dots(points, svg.DEEP, 1.8)]))
    label = f"Normal probability plot of {spec.name}, a straight line if it is normal. {response.normality.reason}"
    return svg.figure(frame, label, marks)


def tick_scores(shares: Sequence[float], reach: float) -> list[tuple[float, str]]:
    """Return the normal scores of shares, each with its text in percent, as ticks up to `reach` sigmas."""
    return [(float(ndtri(p)), f"{100 * p:g}") for p in shares if abs(ndtri(p)) < reach]


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
    x, y = (math.log10(run.n[first]), math.log10(run.n[-1]) + 1e-9), svg.around([low, high, *near])
    frame = svg.PlotArea(svg.HALF, svg.TALL, x, y, left=svg.y_room(*y), top=28)
    n = [math.log10(count) for count in run.n[first:]]
    powers = [10**p for p in range(1, 9) if run.n[first] <= 10**p <= run.n[-1]]
    if len(powers) < 3:
        powers = [k * 10**p for p in range(1, 9) for k in (1, 2, 5) if run.n[first] <= k * 10**p <= run.n[-1]]
    if len(powers) < 3:  # a range in which hardly one of these lies
        powers = [round(count) for count, _ in svg.labelled(run.n[first], run.n[-1], 5) if count == round(count)]
    ticks = [(math.log10(p), format_numbers.grouped(p)) for p in powers or [run.n[-1]]]
    unit = spec.unit if run.index == "mean" else "1"
    marks = [
        svg.axis_y(frame, svg.axis_name(f"{run.index}", unit)),
        svg.band(frame, n, run.low[first:], run.high[first:], svg.BAND),
        svg.curve(frame, n, run.value[first:], svg.DEEP),
        *(
            svg.line([(frame.left, frame.up(b)), (frame.width - frame.right, frame.up(b))], svg.LIMIT, 1.2, "7 4")
            for b in near
        ),
        *(svg.text(frame.width - frame.right - 2, frame.up(b) - 4, f"{b:.2f}", "end", svg.LIMIT) for b in near),
        svg.axis_x(frame, "samples", ticks),
    ]
    label = (
        f"{run.index} of {spec.name} over the first samples: {format_numbers.significant(run.value[-1], 4)}, "
        f"{format_numbers.significant(run.low[-1], 4)} to {format_numbers.significant(run.high[-1], 4)}, "
        f"after {run.n[-1]}."
    )
    return svg.figure(frame, label, marks)


def tornado_figure(response: ResponseAnalysis) -> str | None:
    """Return a tornado chart of the effect of each variable on the expected response; None without a sensitivity."""
    influences = response.sensitivity.ranked if response.sensitivity else ()
    shown = [i for i in influences if i.low is not None and i.high is not None][:_BARS]
    c, spec = response.capability, response.spec
    if not shown or c.mean is None:
        return None
    lows, highs = [i.low or 0.0 for i in shown], [i.high or 0.0 for i in shown]
    height = 62.0 + 22 * len(shown)
    left = min(16 + max(svg.text_width(i.variable) for i in shown), 170.0)
    frame = svg.PlotArea(svg.HALF, height, svg.around([*lows, *highs, c.mean]), (0, len(shown)), left=left, top=8)
    marks = []
    for row, (influence, low, high) in enumerate(zip(shown, lows, highs, strict=True)):
        y = frame.top + 22 * row
        x, end = frame.across(low), frame.across(high)
        colour = svg.DEEP if influence.verdict == "critical" else svg.PALE
        marks += [
            svg.box(x, y + 3, max(end - x, 0.8), 15, colour),
            svg.text(frame.left - 6, y + 15, svg.shortened(influence.variable, left - 8), "end"),
        ]
    middle = frame.across(c.mean)
    marks.append(svg.line([(middle, frame.top), (middle, frame.ground)], svg.INK, 1, "3 3"))
    marks.append(svg.axis_x(frame, f"expected {svg.axis_name(spec.name, spec.unit)}"))
    ranges = "; ".join(
        f"{i.variable} {format_numbers.significant(i.low)} to {format_numbers.significant(i.high)}" for i in shown
    )
    label = f"Tornado of {spec.name}: expected value with each variable from its 5th to its 95th percentile: {ranges}."
    return svg.figure(frame, label, marks)


def scatter_figure(response: ResponseAnalysis, scatter: Scatter, unit: str) -> str:
    """Return the figure of a response against an input: points, means over groups, and limits."""
    spec = response.spec
    limits = [(name, value) for name, value in (("LSL", spec.lsl), ("USL", spec.usl)) if value is not None]
    low = min(scatter.y)
    shown, beyond_reach = svg.with_near([low, max(scatter.y)], [value for _, value in limits])
    y = svg.around(shown)
    frame = svg.PlotArea(svg.HALF, svg.TALL, svg.around([*scatter.x]), y, left=svg.y_room(*y), top=26)
    inside, outside = list[tuple[float, float]](), list[tuple[float, float]]()
    for at, value in zip(scatter.x, scatter.y, strict=True):
        out = (spec.lsl is not None and value < spec.lsl) or (spec.usl is not None and value > spec.usl)
        (outside if out else inside).append((frame.across(at), frame.up(value)))
    radius = 2.2 if len(scatter.x) <= 200 else 1.5
    marks = [svg.axis_y(frame, svg.axis_name(spec.name, spec.unit)), svg.dots(inside, svg.BAR, radius)]
    marks += [svg.dots(outside, svg.REJECT, radius)] if outside else []
    marks += [svg.curve(frame, scatter.mean_x, scatter.mean_y, svg.INK)] if scatter.mean_x else []
    far = []
    for name, value in limits:
        words = f"{name} {format_numbers.plain(value)}"
        if value not in beyond_reach:
            ends = [(frame.left, frame.up(value)), (frame.width - frame.right, frame.up(value))]
            marks.append(svg.line(ends, svg.LIMIT, 1.5, "7 4"))
            above = frame.up(value) - 5 > frame.top
            marks.append(svg.text(ends[1][0] - 2, frame.up(value) + (-5 if above else 15), words, "end", svg.LIMIT))
        else:
            far.append(f"{words} is far {'below' if value < low else 'above'}")
    if far:
        marks.append(svg.text(frame.left, 14, "; ".join(far), "start", svg.LIMIT))
    marks.append(svg.axis_x(frame, svg.axis_name(scatter.variable, unit)))
    slope = "" if scatter.slope is None else f", slope {format_numbers.significant(scatter.slope)}"
    beyond = f", {len(outside)} of them out of limits" if limits else ""
    label = f"{spec.name} against {scatter.variable}: {len(scatter.x)} points{beyond}{slope}."
    return svg.figure(frame, label, marks)


def slope_unit(response: str, variable: str) -> str:
    """Return the unit of a slope, with a space before it."""
    bare = ("", "1")
    if variable in bare:
        return "" if response in bare else f" {response}"
    above = "1" if response in bare else response
    return f" {above}/{variable}" if " " not in variable and "/" not in variable else f" {above}/({variable})"


def _curves(frame: svg.PlotArea, curves: list[tuple[Array, Array, str, str]]) -> list[str]:
    """Return the parts of the curves (x, y, colour, dash) that lie inside a figure."""
    marks = []
    for x, y, colour, dash in curves:
        seen = (x >= frame.x[0]) & (x <= frame.x[1]) & (y <= frame.y[1])
        marks += [svg.curve(frame, x[seen].tolist(), y[seen].tolist(), colour, dash)] if seen.any() else []
    return marks


def _bars(frame: svg.PlotArea, bins: Histogram, low: float | None, high: float | None) -> str:
    """Return the bars; those outside the limits are coloured and hatched."""
    edges, heights = density_bars(bins)
    marks = []
    for left, right, height in zip(edges[:-1], edges[1:], heights, strict=True):
        if height == 0:
            continue
        # The bounds of a variable need not be edges of its bins: only a bar completely outside is marked.
        outside = (low is not None and right <= low) or (high is not None and left > high)
        x, end, top = frame.across(left), frame.across(right), frame.up(height)
        top = min(top, frame.ground - 0.8)  # a single value stays visible
        edge = f'stroke="{svg.PAPER}" stroke-width="0.5"'
        marks.append(svg.box(x, top, end - x, frame.ground - top, svg.REJECT if outside else svg.BAR, edge))
        if outside:  # white oblique lines over the bar
            at = [float(y) for y in np.arange(top, frame.ground, _HATCH)]
            marks += [svg.line([(x, y), (end, max(y - (end - x), top))], svg.PAPER, 0.9) for y in at]
    return "\n".join(marks)


def density_bars(bins: Histogram) -> tuple[list[float], list[float]]:
    """Return the edges and heights of the bars, whose total area is 1."""
    edges, counts = np.asarray(bins.edges), np.asarray(bins.counts, dtype=float)
    total = float(counts.sum()) or 1.0
    return edges.tolist(), (counts / (total * np.diff(edges))).tolist()


def _top(density: Array) -> float:
    """Return the largest finite height of a curve."""
    finite = density[np.isfinite(density)]
    return float(np.max(finite, initial=0.0))


_WIDTHS = {"thin": 0.8, "dashed": 0.8, "thick": 3.0, "arrow": 1.6}
_HEAD = 9.0  # length of an arrow's head
_LETTER, _LINE = 0.6, 1.2  # width of a letter and height of a line, relative to the font size
_DARKEST = 0.18  # relative luminance of a colour whose contrast with white is 4.5


def mechanism_figure(drawing: MechanismDrawing) -> str:
    """Return the drawing of a mechanism."""
    marks = [_area(corners, colour) for corners, colour in drawing.areas]
    for stroke in drawing.strokes:
        dash = "3 2" if stroke.style == "dashed" else ""
        marks.append(svg.line(stroke.points, stroke.colour, _WIDTHS[stroke.style], dash))
        marks += [_head(stroke)] if stroke.style == "arrow" and len(stroke.points) > 1 else []
    marks += [svg.dots([(x, y)], colour, 2.4) for x, y, colour in drawing.dots]
    marks += [mark for words in drawing.words for mark in _words(words, drawing.text)]
    listed = "; ".join(f"{each.name}: {each.title or 'no title'}, {each.value}" for each in drawing.legend)
    frame = svg.PlotArea(drawing.width, drawing.height, (0.0, 1.0), (0.0, 1.0))
    return svg.figure(frame, f"The mechanism at its start, with arrows for what is measured. {listed}.", marks)


def _area(corners: tuple[tuple[float, float], ...], colour: str) -> str:
    """Return a body as a light area with an outline."""
    at = " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)
    return f'<polygon points="{at}" fill="{colour}" fill-opacity="0.1" stroke="{colour}" stroke-opacity="0.6"/>'


def _head(stroke: DrawnLine) -> str:
    """Return the head of an arrow; a short arrow has a small one."""
    (ax, ay), (bx, by) = stroke.points[-2:]
    length = math.hypot(bx - ax, by - ay)
    if length == 0:
        return ""
    x, y = (bx - ax) / length, (by - ay) / length
    size = min(_HEAD, max(length, 0.5 * _HEAD))
    sides = [(bx - size * x - s * 0.4 * size * y, by - size * y + s * 0.4 * size * x) for s in (-1, 1)]
    at = " ".join(f"{px:.1f},{py:.1f}" for px, py in ((bx, by), *sides))
    return f'<polygon points="{at}" fill="{stroke.colour}"/>'


def _words(words: DrawnWords, size: float) -> list[str]:
    """Return text on a white, slightly transparent background."""
    size = size if words.bold else 0.92 * size
    wide, tall = _LETTER * size * max(map(len, words.lines)), _LINE * size
    top = words.y - 0.5 * tall * len(words.lines)
    more = f'font-size="{size:.3g}"' + (' font-weight="700"' if words.bold else "")
    ground = svg.box(words.x - 0.5 * wide, top, wide, tall * len(words.lines), "white", 'fill-opacity="0.75"')
    colour = readable(words.colour)
    rows = (
        svg.text(words.x, top + tall * (i + 0.78), each, "middle", colour, more) for i, each in enumerate(words.lines)
    )
    return [ground, *rows]


def readable(colour: str) -> str:
    """Return a colour, darkened if necessary, so that text in it is readable on white (WCAG 2.2 AA)."""
    channels = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    while _luminance(channels) > _DARKEST:
        channels = [0.95 * channel for channel in channels]
    return "#" + "".join(f"{round(255 * channel):02x}" for channel in channels)


def _luminance(channels: list[float]) -> float:
    """Return the relative luminance of red, green and blue from 0 to 1 (sRGB)."""
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
