"""An enlarged view inside a figure, for values that distant limits compress into a sliver."""

from collections.abc import Iterable

from reporting.render.svg import MUTED, PlotArea, axis_x, box, line, text

# Values that occupy less than this part of the axis are shown enlarged.
SLIVER = 0.2
_GAP, _WIDEST = 18.0, 240.0


def is_sliver(low: float, high: float, frame: PlotArea) -> bool:
    """Return whether the range from `low` to `high` is too narrow in a figure to be readable."""
    return 0 < high - low < SLIVER * (frame.x[1] - frame.x[0])


def inset_area(frame: PlotArea, x: tuple[float, float], y: tuple[float, float], limits: Iterable[float]) -> PlotArea:
    """Return the rectangle of an enlarged view of the ranges `x` and `y`: where there is more room, off the limits."""
    start, end = frame.across(x[0]), frame.across(x[1])
    lines = [frame.across(limit) for limit in limits]
    last = min([frame.width - frame.right, *(at for at in lines if at > end)])
    first = max([frame.left, *(at for at in lines if at < start)])
    if last - end > start - first:
        left, right = end + _GAP, min(last - _GAP, end + _GAP + _WIDEST)
    else:
        left, right = max(first + _GAP, start - _GAP - _WIDEST), start - _GAP
    return PlotArea(
        frame.width,
        frame.height,
        x,
        y,
        left=left,
        right=frame.width - right,
        top=frame.top + 20,
        bottom=frame.bottom + 34,
    )


def inset(area: PlotArea, marks: Iterable[str]) -> str:
    """Return the enlarged view: its frame, its axis and its marks."""
    left, right = area.left, area.width - area.right
    corners = [(left, area.top), (right, area.top), (right, area.ground), (left, area.ground), (left, area.top)]
    return "\n".join(
        [
            box(left - 8, area.top - 18, right - left + 16, area.ground - area.top + 42, "white"),
            line(corners, MUTED, 0.8),
            *marks,
            axis_x(area),
            text(0.5 * (left + right), area.top - 6, "enlarged", colour=MUTED),
        ]
    )
