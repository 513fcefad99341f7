"""A response against one of its strongest inputs, as SVG with a description in words."""

from reporting import format_numbers
from reporting.render.axes import BAR, HALF, LIMIT, REJECT, TALL, around, axis_name
from reporting.render.svg import INK, PlotArea, axis_x, axis_y, curve, dots, line, svg, text, y_room
from reporting.response import ResponseAnalysis
from reporting.sensitivity.scatter import Scatter

_FAR = 3.0  # limits farther than this many ranges of the values are named at the edge, not drawn


def scatter_figure(response: ResponseAnalysis, scatter: Scatter, unit: str) -> str:
    """Return the figure of a response against an input: points, means over groups, and limits."""
    spec = response.spec
    limits = [(name, value) for name, value in (("LSL", spec.lsl), ("USL", spec.usl)) if value is not None]
    low, high = min(scatter.y), max(scatter.y)
    span = high - low or abs(high) or 1.0
    near = [value for _, value in limits if low - _FAR * span <= value <= high + _FAR * span]
    y = around([low, high, *near])
    frame = PlotArea(HALF, TALL, around([*scatter.x]), y, left=y_room(*y), top=26)
    inside, outside = list[tuple[float, float]](), list[tuple[float, float]]()
    for at, value in zip(scatter.x, scatter.y, strict=True):
        out = (spec.lsl is not None and value < spec.lsl) or (spec.usl is not None and value > spec.usl)
        (outside if out else inside).append((frame.across(at), frame.up(value)))
    radius = 2.2 if len(scatter.x) <= 200 else 1.5
    marks = [axis_y(frame, axis_name(spec.name, spec.unit)), dots(inside, BAR, radius)]
    marks += [dots(outside, REJECT, radius)] if outside else []
    marks += [curve(frame, scatter.mean_x, scatter.mean_y, INK)] if scatter.mean_x else []
    far = []
    for name, value in limits:
        words = f"{name} {format_numbers.plain(value)}"
        if value in near:
            ends = [(frame.left, frame.up(value)), (frame.width - frame.right, frame.up(value))]
            marks.append(line(ends, LIMIT, 1.5, "7 4"))
            above = frame.up(value) - 5 > frame.top
            marks.append(text(ends[1][0] - 2, frame.up(value) + (-5 if above else 15), words, "end", LIMIT))
        else:
            far.append(f"{words} is far {'below' if value < low else 'above'}")
    if far:
        marks.append(text(frame.left, 14, "; ".join(far), "start", LIMIT))
    marks.append(axis_x(frame, axis_name(scatter.variable, unit)))
    slope = "" if scatter.slope is None else f", slope {format_numbers.significant(scatter.slope)}"
    beyond = f", {len(outside)} of them out of limits" if limits else ""
    label = f"{spec.name} against {scatter.variable}: {len(scatter.x)} points{beyond}{slope}."
    return svg(frame, label, marks)


def slope_unit(response: str, variable: str) -> str:
    """Return the unit of a slope, with a space before it."""
    bare = ("", "1")
    if variable in bare:
        return "" if response in bare else f" {response}"
    above = "1" if response in bare else response
    return f" {above}/{variable}" if " " not in variable and "/" not in variable else f" {above}/({variable})"
