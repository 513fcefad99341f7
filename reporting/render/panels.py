"""The panels of the first screen and of a response's page, as SVG with a description in words.

Of all responses: the position of each between its limits, and the goal plot of centring and spread. The page of a
response has six: values in order, the index with its requirement, causes, probability, two scatters, and its histogram
(`reporting.render.figures.response_figure`). Each row of the summary has a small histogram without words.
"""

import math
from itertools import pairwise
from typing import cast

import numpy as np
from scipy.special import ndtr

from reporting import format_numbers
from reporting.analysis import Analysis
from reporting.capability.intervals import Estimate
from reporting.capability.row_order import ControlChart
from reporting.capability.verdict import (
    CAPABLE,
    FEWEST_FOR_A_VERDICT,
    MARGINAL,
    PERCENTILE,
    WEIGHTED,
    CapabilityVerdict,
    bars_of,
)
from reporting.render import svg
from reporting.render.figures import PROBABILITIES, density_bars, tick_scores
from reporting.response import ResponseAnalysis
from reporting.sensitivity.scatter import Scatter
from reporting.shape.estimates import index_estimates
from reporting.shape.fitting import Fit, distribution

_BARS = 6  # causes; the appendix has all variables
_MINI = (150.0, 34.0)
_BY = {"fitted distribution": "fitted distribution", "tail": "tail", PERCENTILE: "percentiles"}


def mini_histogram(response: ResponseAnalysis) -> str:
    """Return a small histogram with the limits as lines, without axes and words."""
    spec, bins = response.spec, response.histogram
    limits = [value for value in (spec.lsl, spec.usl) if value is not None]
    width, height = _MINI
    ends = [*limits, *((bins.edges[0], bins.edges[-1]) if bins else ())]
    top = max(density_bars(bins)[1]) if bins else 1.0
    frame = svg.PlotArea(width, height, svg.around(ends or [0.0]), (0.0, top or 1.0), left=2, right=2, top=3, bottom=3)
    marks = [svg.line([(frame.left, frame.ground), (frame.width - frame.right, frame.ground)], svg.MUTED, 0.8)]
    if bins:
        edges, heights = density_bars(bins)
        for left, right, tall in zip(edges[:-1], edges[1:], heights, strict=True):
            outside = (spec.lsl is not None and right <= spec.lsl) or (spec.usl is not None and left > spec.usl)
            if tall:
                x, up = frame.across(left), min(frame.up(tall), frame.ground - 1.5)
                marks.append(
                    svg.box(
                        x, up, max(frame.across(right) - x, 0.6), frame.ground - up, svg.REJECT if outside else svg.BAR
                    )
                )
    marks += [svg.line([(frame.across(v), frame.ground), (frame.across(v), 1)], svg.LIMIT, 1.6) for v in limits]
    c = response.capability
    label = f"{c.n} values between the limits" if limits else f"{c.n} values"
    if limits and (c.below or c.above):
        label = f"{(c.below or 0) + (c.above or 0)} of {c.n} values out of limits"
    return svg.figure(frame, f"Distribution of {spec.name}: {label}.", marks)


def control_chart_figure(response: ResponseAnalysis) -> str | None:
    """Return the values in order, or means of them, with control limits; None without a chart."""
    chart, spec = response.chart, response.spec
    if chart is None:
        return None
    low, high = (format_numbers.significant(end, 4) for end in (chart.low[-1], chart.high[-1]))
    label = (
        f"Control chart of {spec.name}, {len(chart.points)} {chart_words(chart)}: limits {low} to {high}. "
        f"{marked_words(chart)}."
    )
    centre = (chart.centre,) * len(chart.points)
    lines = (centre, chart.low, chart.high)
    return _in_order(chart.points, chart.marked, lines, (spec.name, spec.unit), chart_words(chart), label)


def spread_chart_figure(response: ResponseAnalysis) -> str | None:
    """Return the chart of the spread of the points of a control chart; None without one."""
    chart, spec = response.chart, response.spec
    if chart is None or chart.spread is None:
        return None
    found, count = chart.spread, len(chart.spread.beyond)
    words = "1 point is" if count == 1 else f"{count} points are"
    label = f"{found.of.capitalize()} of {spec.name}, {len(found.points)} in order: {words} beyond the limits."
    lines = (found.centre, found.low, found.high)
    return _in_order(found.points, found.beyond, lines, (found.of, spec.unit), f"{found.of}, in order", label)


def _in_order(
    points: tuple[float, ...],
    marked: tuple[int, ...],
    lines: tuple[tuple[float, ...], ...],
    named: tuple[str, str],
    words: str,
    label: str,
) -> str:
    """Return points in order with their centre, lower and upper control limits, which may differ between points."""
    y = svg.around([*points, *lines[1], *lines[2]])
    frame = svg.PlotArea(svg.HALF, svg.TALL, (0.5, len(points) + 0.5), y, left=svg.y_room(*y), right=44, top=14)
    at = [(frame.across(i + 1), frame.up(point)) for i, point in enumerate(points)]
    marks = [svg.axis_y(frame, svg.axis_name(*named))]
    for values, name, colour, dash in zip(
        lines, ("mean", "LCL", "UCL"), (svg.MUTED, svg.TARGET, svg.TARGET), ("", "7 4", "7 4"), strict=True
    ):
        steps = [0.5, *(i + 0.5 for i in range(1, len(values)) if values[i] != values[i - 1]), len(values) + 0.5]
        path = [
            (frame.across(end), frame.up(values[int(start)]))
            for start, stop in pairwise(steps)
            for end in (start, stop)
        ]
        marks.append(svg.line(path, colour, 1.2, dash))
        marks.append(svg.text(frame.width - frame.right + 4, frame.up(values[-1]) + 4, name, "start", colour))
    marks += [svg.line(at, svg.BAR, 1), svg.dots(at, svg.DEEP, 2.4)]
    marks += [svg.dots([at[i] for i in marked], svg.REJECT, 4)] if marked else []
    marks.append(svg.axis_x(frame, words))
    return svg.figure(frame, label, marks)


def chart_words(chart: ControlChart) -> str:
    """Return what the points of a chart are."""
    if chart.kind == "ewma":
        return "moving averages (EWMA), in order"
    if chart.of == "subgroups":
        return "means of subgroups, in order"
    if chart.of == "lots":
        return "means of lots, in order" if chart.size == 1 else f"means of {chart.size} lots, in order"
    return "samples, in order" if chart.size == 1 else f"means of {chart.size} samples, in order"


def marked_words(chart: ControlChart) -> str:
    """Return how many points of a chart break a rule, and of measured parts which rules."""
    count = len(chart.marked)
    words = {0: "No point breaks a rule", 1: "1 point breaks a rule"}.get(count, f"{count} points break a rule")
    if not count or chart.spread is None:
        return words
    rules = "; ".join(f"{name}, {chart.texts[name]}: {len(those)}" for name, those in chart.marks.items() if those)
    return f"{words} ({rules})"


def deciding_fit(response: ResponseAnalysis) -> Fit | None:
    """Return the fitted family of a response that is not judged by Cpk; None for the normal distribution."""
    fit = response.fits.of(response.fits.best)
    by_normal = response.verdict.by in ("", "index")
    return fit if not by_normal and fit is not None and fit.family != "normal" else None


def decides(response: ResponseAnalysis) -> bool:
    """Return whether the family of the probability plot decides the verdict, and no tail, count or weighted run."""
    by = response.verdict.by
    return by == "index" or (by in ("fitted distribution", PERCENTILE) and response.fits.best is not None)


def deciding_probability_figure(response: ResponseAnalysis) -> str | None:
    """Return the probability plot with the family that decides; None without one."""
    plot, spec, c = response.plot, response.spec, response.capability
    if plot is None or c.mean is None or not c.std:
        return None
    limits = [v for v in (spec.lsl, spec.usl) if v is not None]
    reach = max(3.1, float(np.max(np.abs(plot.scores))) + 0.2)
    shown, far = svg.with_near([*plot.values], limits)
    frame = svg.PlotArea(svg.HALF, svg.TALL, svg.around(shown), (-reach, reach), left=76, top=28)
    z = np.linspace(-reach, reach, 161)
    fit = deciding_fit(response)
    marks = [svg.axis_y(frame, "values below [%]", tick_scores(PROBABILITIES, reach))]
    curves = [(c.mean + z * c.std, svg.MUTED if fit else svg.INK, "2 3" if fit else "")]
    if fit is not None:
        with np.errstate(all="ignore"):
            curves.append((distribution(fit).ppf(ndtr(z)), svg.FIT, ""))
    else:
        for side in (plot.low, plot.high):
            marks.append(_inside(frame, np.asarray(side), np.asarray(plot.scores), svg.MUTED, "4 3"))
    marks += [_inside(frame, x, z, colour, dash) for x, colour, dash in curves]
    points = ((frame.across(v), frame.up(s)) for v, s in zip(plot.values, plot.scores, strict=True))
    marks += [svg.dots(points, svg.DEEP, 1.8), svg.axis_x(frame, svg.axis_name(spec.name, spec.unit))]
    named = [(v, f"{name} {format_numbers.plain(v)}") for v, name in ((spec.lsl, "LSL"), (spec.usl, "USL"))]
    near = [(v, name) for v, name in ((spec.lsl, "LSL"), (spec.usl, "USL")) if v is not None and v not in far]
    marks += svg.limit_markers(frame, near)
    marks += _far_names(frame, [(v, words) for v, words in named if v in far])
    family = fit.title if fit else "the normal distribution"
    return svg.figure(frame, f"Probability plot of {spec.name} with {family}. {response.normality.reason}", marks)


def index_figure(response: ResponseAnalysis) -> str | None:
    """Return every estimate of the index with its interval, and the requirement; None with too few values."""
    found, spec, c = response.verdict, response.spec, response.capability
    if c.cpk is None or (not found.by and c.n < FEWEST_FOR_A_VERDICT):
        return None
    rows = _estimates(response)
    needed = bars_of(spec.requirement)
    ends = [needed.capable, needed.marginal]
    ends += [v for _, e, _ in rows for v in (e.low, e.value, e.high) if math.isfinite(v)]
    most = 2.5 * max(needed.capable, *(e.value for _, e, _ in rows if math.isfinite(e.value)))
    x = svg.around([min(max(v, -1.0), most) for v in ends])
    left = 18 + max(svg.text_width(name) for name, _, _ in rows)
    height = max(svg.TALL, 84.0 + 34 * len(rows))
    frame = svg.PlotArea(svg.HALF, height, x, (0.0, 1.0), left=left, right=20, top=28)
    step = (frame.ground - frame.top) / len(rows)
    words = f"required {format_numbers.plain(needed.capable)}"
    marks = [
        svg.line(
            [(frame.across(needed.marginal), frame.top), (frame.across(needed.marginal), frame.ground)], svg.GRID, 2
        ),
        svg.marker(frame, needed.capable, words, svg.TARGET, ""),
    ]
    for row, (name, estimate, decides) in enumerate(rows):
        y = frame.top + step * (row + 0.55)
        low, high = (frame.across(min(max(end, x[0]), x[1])) for end in (estimate.low, estimate.high))
        colour = svg.INK if decides else svg.MUTED
        marks.append(svg.line([(low, y), (high, y)], colour, 4 if decides else 1.6))
        marks += [
            svg.line([(at, y - 5), (at, y + 5)], colour, 1.6)
            for at, end in ((low, estimate.low), (high, estimate.high))
            if x[0] <= end <= x[1]
        ]
        value = "none"
        if math.isfinite(estimate.value) and estimate.value <= x[1]:
            marks.append(svg.dots([(frame.across(max(estimate.value, x[0])), y)], colour, 5 if decides else 3.5))
            value = format_numbers.index(estimate.value)
        elif estimate.value > x[1]:
            value = f"> {format_numbers.significant(x[1], 3)}"
        bold = 'font-weight="700"' if decides else ""
        middle = min(max(0.5 * (low + high), frame.left + 20), frame.width - frame.right - 20)
        if value != "none":
            at = frame.across(min(max(estimate.value, x[0]), x[1]))
            middle = min(max(at, frame.left + 20), frame.width - frame.right - 20)
            marks.append(svg.text(middle, y - 9, value, colour=colour, more=bold))
        marks.append(svg.text(frame.left - 8, y + 4, name, "end", colour, bold))
    marks.append(svg.axis_x(frame, "index"))
    values = "; ".join(f"{name} {e.note}" for name, e, _ in rows)
    return svg.figure(
        frame, f"Index of {spec.name}, required {format_numbers.plain(spec.requirement)}: {values}.", marks
    )


def _estimates(response: ResponseAnalysis) -> list[tuple[str, Estimate, bool]]:
    """Return name, estimate and whether it decides, the deciding one first."""
    found, c = response.verdict, response.capability
    assert c.cpk is not None
    low, high = c.cpk_interval or (c.cpk, c.cpk)
    normal = Estimate(c.cpk, (low, high), "index", format_numbers.index(c.cpk))
    rows = [("Cpk", normal)]
    rows += [(_BY[e.method], e) for e in index_estimates(c.n, response.fits, response.methods, response.tails)]
    known = [(name, e, e.method == found.by) for name, e in rows]
    if found.by and not any(decides for _, _, decides in known):
        value = math.inf if found.index is None else found.index
        ends = (-math.inf if found.index_low is None else found.index_low, found.index_high or math.inf)
        names = {"count": "count of rejects", WEIGHTED: "weighted runs"}
        deciding = Estimate(value, ends, found.by, format_numbers.index(value))
        known = [(names.get(found.by, found.by), deciding, True), *known]
    return sorted(known, key=lambda each: not each[2])[:5]


def causes_figure(response: ResponseAnalysis) -> str | None:
    """Return the shares of the variance by variable with their intervals, and what none causes; or None."""
    s = response.sensitivity
    shown = [i for i in s.ranked if i.share is not None][:_BARS] if s else []
    if s is None or not shown:
        return None
    rows: list[tuple[str, float, tuple[float, float] | None, str]] = []
    for i in shown:
        interval = i.shapley_interval if i.shapley is not None else i.total_interval if i.total is not None else None
        interval = interval or (i.first_order_interval if i.shapley is None and i.total is None else None)
        rows.append((i.variable, i.share or 0.0, interval, svg.DEEP if i.verdict == "critical" else svg.PALE))
    if s.scatter is not None:
        rows.append(("scatter", s.scatter, s.scatter_interval, svg.MUTED))
    rest = s.rest if s.scatter is not None else s.interaction
    if rest is not None:
        rows.append(("interactions" if s.scatter is not None else "the rest", max(rest, 0.0), None, svg.MUTED))
    left = min(18 + max(svg.text_width(name) for name, *_ in rows), 170.0)
    most = min(max(1.05 * max(max(share, (interval or (0, 0))[1]) for _, share, interval, _ in rows), 0.2), 1.0)
    frame = svg.PlotArea(svg.HALF, svg.TALL, (0.0, 100 * most), (0.0, 1.0), left=left, right=64, top=10)
    step = (frame.ground - frame.top) / len(rows)
    marks = []
    for row, (name, share, interval, colour) in enumerate(rows):
        y, tall = frame.top + step * (row + 0.5), min(0.62 * step, 18.0)
        end = frame.across(100 * min(share, most))
        marks.append(svg.box(frame.left, y - tall / 2, max(end - frame.left, 0.8), tall, colour))
        last = end
        if interval:
            a, b = (frame.across(100 * min(max(v, 0.0), most)) for v in interval)
            marks.append(svg.line([(a, y), (b, y)], svg.INK, 1.4))
            marks += [svg.line([(x, y - 4), (x, y + 4)], svg.INK, 1.4) for x in (a, b)]
            last = max(end, b)
        marks.append(svg.text(last + 6, y + 4.5, format_numbers.part(share), "start"))
        marks.append(svg.text(frame.left - 6, y + 4.5, svg.shortened(name, left - 8), "end"))
    marks.append(svg.axis_x(frame, "share of the variance [%]"))
    listed = "; ".join(f"{name} {format_numbers.part(share)}" for name, share, *_ in rows)
    return svg.figure(frame, f"Causes of the variance of {response.spec.name}: {listed}.", marks)


def scatters_figure(response: ResponseAnalysis, units: dict[str, str]) -> str | None:
    """Return the response against its two strongest inputs, side by side on one axis; `units` of the variables."""
    pairs, spec = response.scatters, response.spec
    if not pairs:
        return None
    values = [v for pair in pairs for v in (min(pair.y), max(pair.y))]
    limits = [v for v in (spec.lsl, spec.usl) if v is not None]
    shown, far = svg.with_near(values, limits)
    y = svg.around(shown)
    left, gap, right = svg.y_room(*y), 22.0, 12.0
    each = (svg.HALF - left - right - gap * (len(pairs) - 1)) / len(pairs)
    marks, labels = [], []
    for number, pair in enumerate(pairs):
        start = left + number * (each + gap)
        frame = svg.PlotArea(
            svg.HALF,
            svg.TALL,
            svg.around([*pair.x]),
            y,
            left=start,
            right=svg.HALF - start - each,
            top=26 if far else 14,
        )
        if number == 0:
            whole = svg.PlotArea(svg.HALF, svg.TALL, frame.x, y, left=left, right=right, top=frame.top)
            marks.append(svg.axis_y(whole, svg.axis_name(spec.name, spec.unit)))
            named = [(v, f"{name} {format_numbers.plain(v)}") for v, name in ((spec.lsl, "LSL"), (spec.usl, "USL"))]
            marks += _far_names(frame, [(v, words) for v, words in named if v in far], vertical=True)
            for v, words in named:
                if v is not None and v not in far:
                    marks.append(
                        svg.line([(left, frame.up(v)), (svg.HALF - right, frame.up(v))], svg.LIMIT, 1.5, "7 4")
                    )
                    below = 14 if frame.up(v) - 14 < frame.top else -4
                    marks.append(svg.text(svg.HALF - right - 2, frame.up(v) + below, words, "end", svg.LIMIT))
        marks += _points(frame, pair, spec.lsl, spec.usl)
        marks.append(svg.axis_x(frame, svg.axis_name(pair.variable, units.get(pair.variable, "1"))))
        slope = "" if pair.slope is None else f", slope {format_numbers.significant(pair.slope)}"
        labels.append(f"{pair.variable}{slope}")
    return svg.figure(
        svg.PlotArea(svg.HALF, svg.TALL, (0, 1), (0, 1)), f"{spec.name} against {' and '.join(labels)}.", marks
    )


def _points(frame: svg.PlotArea, pair: Scatter, lsl: float | None, usl: float | None) -> list[str]:
    """Return the points of a scatter plot, those out of limits in red, and the means over groups."""
    inside, outside = list[tuple[float, float]](), list[tuple[float, float]]()
    for at, value in zip(pair.x, pair.y, strict=True):
        out = (lsl is not None and value < lsl) or (usl is not None and value > usl)
        (outside if out else inside).append((frame.across(at), frame.up(value)))
    radius = 2.0 if len(pair.x) <= 200 else 1.4
    marks = [svg.dots(inside, svg.BAR, radius)] if inside else []
    marks += [svg.dots(outside, svg.REJECT, radius)] if outside else []
    return marks + ([svg.curve(frame, pair.mean_x, pair.mean_y, svg.INK)] if pair.mean_x else [])


def _far_names(frame: svg.PlotArea, far: list[tuple[float | None, str]], *, vertical: bool = False) -> list[str]:
    """Return the names of limits outside the figure, at the edge where they lie; on one line for a vertical axis."""
    low, high = frame.y if vertical else frame.x
    before = [words for v, words in far if v is not None and v < low]
    after = [words for v, words in far if v is not None and v > high]
    if vertical:
        words = [f"{w} is far below" for w in before] + [f"{w} is far above" for w in after]
        return [svg.text(frame.left, 14, "; ".join(words), "start", svg.LIMIT)] if words else []
    marks = [svg.text(frame.left, frame.top - 8, f"← {w}", "start", svg.LIMIT) for w in before]
    return marks + [svg.text(frame.width - frame.right, frame.top - 8, f"{w} →", "end", svg.LIMIT) for w in after]


def _inside(frame: svg.PlotArea, x: "np.ndarray", y: "np.ndarray", colour: str, dash: str) -> str:
    """Return the part of a curve inside the figure; empty without one."""
    kept = np.isfinite(x) & (x >= frame.x[0]) & (x <= frame.x[1])
    return svg.curve(frame, x[kept].tolist(), y[kept].tolist(), colour, dash) if kept.any() else ""


COLOURS = {"capable": svg.TARGET, "marginal": svg.AMBER, "not capable": svg.LIMIT}
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
    left = min(24 + max(svg.text_width(_marked(r)) for r in shown), 150.0)
    frame = svg.PlotArea(svg.HALF, 78 + _ROW * len(shown), (low, high), (0, 1), left=left, top=26)
    marks = [svg.line([(frame.across(0), frame.top), (frame.across(0), frame.ground)], svg.GRID, 1.2)]
    for row, (response, part) in enumerate(zip(shown, parts, strict=True)):
        y, spec = frame.top + _ROW * (row + 0.5), response.spec
        colour = verdict_colour(response.verdict)
        start, mean, end, least, largest = (frame.across(min(max(p, low), high)) for p in part)
        first = frame.across(low if spec.lsl is None else -1)
        last = frame.across(high if spec.usl is None else 1)
        marks += [
            svg.box(first, frame.top + _ROW * row, last - first, _ROW, svg.BETWEEN),
            svg.box(start, y - 6, end - start, 12, colour, 'fill-opacity="0.55"'),
            svg.line([(least, y), (largest, y)], colour, 1.6),
            svg.dots([(mean, y)], svg.INK, 3),
            svg.text(frame.left - 6, y + 4, svg.shortened(_marked(response), left - 8), "end"),
        ]
    marks += [svg.marker(frame, at, name, svg.LIMIT, "7 4") for at, name in ((-1.0, "LSL"), (1.0, "USL"))]
    marks.append(svg.axis_x(frame, "position: 0 in the middle, ±1 on a limit"))
    verdicts = "; ".join(f"{r.spec.name} {_in_words(r)}, Cpk {format_numbers.index(r.capability.cpk)}" for r in shown)
    return svg.figure(frame, f"Position and spread of every response between its limits: {verdicts}.", marks)


def goal_figure(analysis: Analysis) -> str | None:
    """Return the figure of offset and spread of every response in units of its tolerance, with Cpk lines; or None."""
    shown = [r for r in in_overview(analysis) if r.capability.cp is not None]
    if not shown:
        return None
    points = [_offset_and_spread(r) for r in shown]
    reach = min(max(0.55, *(1.1 * abs(x) for x, _ in points)), 1.5)
    top = min(max(0.19, *(1.15 * y for _, y in points)), 0.8)
    frame = svg.PlotArea(svg.HALF, 330, (-reach, reach), (0.0, top), top=14)
    marks, taken = [svg.axis_y(frame, "σ / (USL − LSL)")], list[Box]()
    for row, (index, colour) in enumerate(((MARGINAL, COLOURS["not capable"]), (CAPABLE, COLOURS["capable"]))):
        peak = 0.5 / (3 * index)
        corners = [(-0.5, 0.0), (0.0, peak), (0.5, 0.0)]
        marks.append(svg.line(((frame.across(x), frame.up(y)) for x, y in corners), colour, 1.6, "7 4"))
        # A key in the corner: beside the lines there may be no room between them.
        words, height = f"Cpk {index:.2f}", frame.top + 12 + 18 * row
        start = frame.left + 36
        marks.append(svg.line([(frame.left + 4, height - 4), (start - 6, height - 4)], colour, 1.6, "7 4"))
        marks.append(svg.text(start, height, words, "start", colour, 'font-weight="600"'))
        taken.append((frame.left, height - svg.SIZE, start + svg.text_width(words) + 6, height + 4))
    places = [(frame.across(min(max(x, -reach), reach)), frame.up(min(y, top))) for x, y in points]
    taken += [(x - _DOT, y - _DOT, x + _DOT, y + _DOT) for x, y in places]
    named = []
    for r, (x, y) in zip(shown, places, strict=True):
        named += _named(svg.shortened(r.spec.name, _LONGEST), x, y, frame, taken)
        marks.append(svg.dots([(x, y)], verdict_colour(r.verdict), _DOT))
    marks += [*named, svg.axis_x(frame, "(mean − middle) / (USL − LSL)")]
    offsets = "; ".join(
        f"{r.spec.name} offset {x:.3f}, spread {y:.4f}" for r, (x, y) in zip(shown, points, strict=True)
    )
    return svg.figure(frame, f"Goal plot, both in units of the tolerance: {offsets}.", marks)


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
    return COLOURS.get("marginal" if uncertain else found.word, svg.MUTED)


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


def _named(name: str, x: float, y: float, frame: svg.PlotArea, taken: list[Box]) -> list[str]:
    """Return the name of a dot at a free position, with a line to the dot if it is far; add its box to `taken`."""
    # If there is no room the name is left out; the description of the figure contains it.
    for ring in range(_RINGS):
        for i in range(_DIRECTIONS):
            turn = 2 * math.pi * i / _DIRECTIONS
            across, down = math.cos(turn), math.sin(turn)
            wide, tall = 0.5 * svg.text_width(name) + 2, 0.5 * svg.SIZE + 2
            reach = min(wide / max(abs(across), 1e-9), tall / max(abs(down), 1e-9)) + _DOT + 2 + _RING * ring
            middle, height = x + reach * across, y + reach * down
            found = middle - wide, height - (tall - 1), middle + wide, height + (tall - 1)
            if _is_free(found, frame, taken):
                taken.append(found)
                leader = [
                    svg.line(
                        [(x, y), (min(max(x, found[0]), found[2]), min(max(y, found[1]), found[3]))], svg.MUTED, 0.7
                    )
                ]
                ground = svg.box(
                    found[0], found[1], found[2] - found[0], found[3] - found[1], svg.PAPER, 'fill-opacity="0.8"'
                )
                return [*(leader if ring else []), ground, svg.text(middle, height + 0.35 * svg.SIZE, name)]
    return []


def _is_free(found: Box, frame: svg.PlotArea, taken: list[Box]) -> bool:
    """Return whether a rectangle lies in the plot and overlaps no other one."""
    left, top, right, bottom = found
    if left < frame.left or right > frame.width or top < 0 or bottom > frame.ground:
        return False
    return all(right <= a or c <= left or bottom <= b or d <= top for a, b, c, d in taken)
