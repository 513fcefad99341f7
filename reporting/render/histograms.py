"""Histograms of responses, of inputs and of a response in two campaigns, as SVG with a description in words."""

import math

import numpy as np

from reporting import format_numbers
from reporting.arrays import Array
from reporting.comparison import ResponseComparison
from reporting.inputs import VariableAnalysis
from reporting.render.axes import (
    BAR,
    FIT,
    HALF,
    LIMIT,
    OTHER,
    REJECT,
    TALL,
    TARGET,
    around,
    axis_name,
    density_name,
    unit_suffix,
)
from reporting.render.inset import inset, inset_area, is_sliver
from reporting.render.svg import INK, PlotArea, axis_x, axis_y, box, curve, line, marker, svg, y_room
from reporting.response import ResponseAnalysis
from reporting.shape.fitting import distribution
from reporting.shape.histogram import Histogram

# Distance of the hatch lines of a bar; an SVG pattern would need an id that is unique on the page.
_HATCH = 5.0


def response_figure(response: ResponseAnalysis) -> str:
    """Return the histogram of a response with its limits, the normal density and the fitted density."""
    spec, c, bins = response.spec, response.capability, response.histogram
    limits = [value for value in (spec.lsl, spec.usl) if value is not None]
    fences = [*limits, *([] if spec.target is None else [spec.target])]
    ends = [*fences, *((bins.edges[0], bins.edges[-1]) if bins else ())]
    curves: list[tuple[Array, Array, str, str]] = []
    if c.mean is not None and c.std:
        x = np.linspace(c.mean - 4.5 * c.std, c.mean + 4.5 * c.std, 121)
        curves.append((x, np.exp(-(((x - c.mean) / c.std) ** 2) / 2) / (c.std * math.sqrt(2 * math.pi)), INK, ""))
        best = response.fits.of(response.fits.best)
        if best is not None and best.family != "normal":
            with np.errstate(all="ignore"):
                density = np.exp(distribution(best).logpdf(x))
            kept = np.isfinite(density)
            curves.append((x[kept], density[kept], FIT, "5 3"))
    most = max([float(np.max(_density(bins)[1])) if bins else 0.0, *(_top(y) for _, y, _, _ in curves)])
    y = (0.0, 1.06 * most or 1.0)
    frame = PlotArea(HALF, TALL, around(ends or [0.0]), y, left=y_room(*y), top=42)
    marks = [axis_y(frame, density_name(spec.unit))]
    marks += [_bars(frame, bins, spec.lsl, spec.usl)] if bins else []
    marks += _curves(frame, curves)
    marks.append(axis_x(frame, axis_name(spec.name, spec.unit)))
    named = (
        (spec.lsl, "LSL", LIMIT, "7 4", 0),
        (spec.usl, "USL", LIMIT, "7 4", 0),
        (spec.target, "target", TARGET, "2 3", 1),
    )
    marks += [
        marker(frame, value, f"{name} {format_numbers.plain(value)}", colour, dash, row)
        for value, name, colour, dash, row in named
        if value is not None
    ]
    if bins is not None and c.min is not None and c.max is not None and is_sliver(c.min, c.max, frame):
        area = inset_area(frame, around([c.min, c.max]), frame.y, limits)
        marks.append(inset(area, [_bars(area, bins, spec.lsl, spec.usl), *_curves(area, curves)]))
    return svg(frame, response_label(response), marks)


def _curves(frame: PlotArea, curves: list[tuple[Array, Array, str, str]]) -> list[str]:
    """Return the parts of the curves (x, y, colour, dash) that lie inside a figure."""
    marks = []
    for x, y, colour, dash in curves:
        seen = (x >= frame.x[0]) & (x <= frame.x[1]) & (y <= frame.y[1])
        marks += [curve(frame, x[seen].tolist(), y[seen].tolist(), colour, dash)] if seen.any() else []
    return marks


def response_label(response: ResponseAnalysis) -> str:
    """Return a description of the histogram of a response."""
    spec, c = response.spec, response.capability
    unit = unit_suffix(spec.unit)
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


def variable_figure(variable: VariableAnalysis) -> str:
    """Return the histogram of an input with the requested density."""
    spec, bins = variable.spec, variable.histogram
    points = np.asarray(spec.density, dtype=float).reshape(-1, 2)
    ends = [*((bins.edges[0], bins.edges[-1]) if bins else ()), *points[:, 0].tolist()]
    most = max(float(np.max(_density(bins)[1])) if bins else 0.0, _top(points[:, 1]))
    y = (0.0, 1.06 * most or 1.0)
    frame = PlotArea(340, 210, around(ends or [0.0]), y, left=y_room(*y), top=12)
    marks = [axis_y(frame, density_name(spec.unit))]
    marks += [_bars(frame, bins, spec.lower, spec.upper)] if bins else []
    if points.size:
        seen = points[points[:, 1] <= frame.y[1]]
        marks.append(curve(frame, seen[:, 0].tolist(), seen[:, 1].tolist()))
    marks.append(axis_x(frame, axis_name(spec.name, spec.unit)))
    label = f"Histogram of input {spec.name}: {variable.n} values; requested {spec.distribution}."
    return svg(frame, label, marks)


def compared_figure(comparison: ResponseComparison) -> str | None:
    """Return the histograms of a response in both campaigns; None if one has no values."""
    bins, other = comparison.histogram, comparison.histogram_other
    if bins is None or other is None:
        return None
    limits = [v for v in (comparison.capability.lsl, comparison.capability.usl) if v is not None]
    most = max(float(np.max(_density(b)[1])) for b in (bins, other))
    x, y = around([*limits, bins.edges[0], bins.edges[-1]]), (0.0, 1.06 * most)
    frame = PlotArea(HALF, TALL, x, y, left=y_room(*y), top=28)
    marks = [axis_y(frame, density_name(comparison.unit)), _bars(frame, bins, None, None)]
    edges, heights = _density(other)
    steps = [(edges[0], 0.0)]
    for left, right, height in zip(edges[:-1], edges[1:], heights, strict=True):
        steps += [(left, height), (right, height)]
    steps.append((edges[-1], 0.0))
    marks.append(line(((frame.across(x), frame.up(y)) for x, y in steps), OTHER, 2))
    marks.append(axis_x(frame, axis_name(comparison.response, comparison.unit)))
    marks += [
        marker(frame, v, f"{name} {format_numbers.plain(v)}", LIMIT, "7 4")
        for v, name in ((comparison.capability.lsl, "LSL"), (comparison.capability.usl, "USL"))
        if v is not None
    ]
    mean, other_mean = (c.mean for c in (comparison.capability, comparison.capability_other))
    label = (
        f"{comparison.response} in both campaigns: bars, {comparison.n} values of this campaign with mean "
        f"{format_numbers.significant(mean, 4)}; line, {comparison.n_other} values of the other campaign with mean "
        f"{format_numbers.significant(other_mean, 4)}."
    )
    return svg(frame, label, marks)


def _bars(frame: PlotArea, bins: Histogram, low: float | None, high: float | None) -> str:
    """Return the bars; those outside the limits are coloured and hatched."""
    edges, heights = _density(bins)
    marks = []
    for left, right, height in zip(edges[:-1], edges[1:], heights, strict=True):
        if height == 0:
            continue
        # The bounds of a variable need not be edges of its bins: only a bar completely outside is marked.
        outside = (low is not None and right <= low) or (high is not None and left > high)
        x, end, top = frame.across(left), frame.across(right), frame.up(height)
        top = min(top, frame.ground - 0.8)  # a single value stays visible
        edge = 'stroke="white" stroke-width="0.5"'
        marks.append(box(x, top, end - x, frame.ground - top, REJECT if outside else BAR, edge))
        if outside:
            marks += _hatched(x, end, top, frame.ground)
    return "\n".join(marks)


def _hatched(left: float, right: float, top: float, ground: float) -> list[str]:
    """Return white oblique lines over a bar."""
    at = np.arange(top, ground, _HATCH)
    return [line([(left, float(y)), (right, max(float(y) - (right - left), top))], "white", 0.9) for y in at]


def _density(bins: Histogram) -> tuple[list[float], list[float]]:
    """Return the edges and heights of the bars, whose total area is 1."""
    edges, counts = np.asarray(bins.edges), np.asarray(bins.counts, dtype=float)
    total = float(counts.sum()) or 1.0
    return edges.tolist(), (counts / (total * np.diff(edges))).tolist()


def _top(density: Array) -> float:
    """Return the largest finite height of a curve."""
    finite = density[np.isfinite(density)]
    return float(np.max(finite, initial=0.0))
