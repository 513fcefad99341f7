"""SVG marks in the coordinates of a plot: lines, bands, boxes, dots, text, axes, and an enlarged view inside a figure.

The report draws its own SVG instead of using matplotlib for four reasons: the same numbers give the same bytes; text
stays text, in the font of the page, for search and screen readers; the 24 figures of six responses take 0.02 s and
190 kB, whereas matplotlib 3.11 takes 1.5 s and 610 kB for the same plots, and 0.4 s for its import; and `reporting`
needs no plotting package.

Colours are attributes instead of style sheets, which some SVG viewers do not support.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from markupsafe import escape

from reporting import format_numbers

INK, MUTED, GRID = "#1d2733", "#4d5967", "#e3e7ec"
SIZE = 13.0  # font size, in the figure's units
_WIDTH_OF_A_LETTER = 0.56  # relative to the font size, on average
BAR, REJECT, LIMIT, TARGET, FIT, OTHER = "#7fa6cc", "#c2371d", "#a61c00", "#1f6f43", "#7a3e9d", "#c9772b"
DEEP, PALE, BAND, BETWEEN, AMBER, PAPER = "#1b5f9e", "#9db4cb", "#cfdeee", "#eef3f8", "#8a5a00", "#ffffff"
# Each colour on a dark page; text colours have a contrast of 4.5 or more with #12181f.
DARK = {
    **{INK: "#e4e9f0", MUTED: "#a3b0bf", GRID: "#2c3743", PAPER: "#12181f"},
    **{BAR: "#5b8ab8", REJECT: "#f0775e", LIMIT: "#ff8a75", TARGET: "#6cc799", FIT: "#c79be6", OTHER: "#e39a52"},
    **{DEEP: "#7db5ea", PALE: "#4f6a86", BAND: "#24384d", BETWEEN: "#1b2633", AMBER: "#e0b04c"},
}
# Figures are as wide as a telephone, so that their text is readable on one; wider screens show two side by side.
HALF, TALL = 480.0, 262.0
# Values that occupy less than this part of the axis are shown enlarged.
SLIVER = 0.2
OFF = 0.4  # the same where the values lie beyond a limit, and the rest of the figure is empty
# A limit farther from the values than this many of their ranges is named at the edge of a figure, not drawn.
NEAR = 0.75
_GAP, _WIDEST = 18.0, 240.0


@dataclass(frozen=True)
class PlotArea:
    """The rectangle of a figure that contains the plot, and the numbers at its ends."""

    width: float  # of the whole figure
    height: float
    x: tuple[float, float]  # numbers at the left and right end
    y: tuple[float, float]  # numbers at the bottom and top
    left: float = 64.0  # left to bottom are margins
    right: float = 16.0
    top: float = 24.0
    bottom: float = 48.0

    def across(self, value: float) -> float:
        """Return the horizontal position of a number."""
        low, high = self.x
        return self.left + (value - low) / (high - low) * (self.width - self.left - self.right)

    def up(self, value: float) -> float:
        """Return the vertical position of a number, measured from the top."""
        low, high = self.y
        return self.height - self.bottom - (value - low) / (high - low) * (self.height - self.top - self.bottom)

    @property
    def ground(self) -> float:
        """Vertical position of the x axis."""
        return self.height - self.bottom


def figure(frame: PlotArea, label: str, marks: Iterable[str]) -> str:
    """Return the figure; `label` describes it in words."""
    body = "\n".join(marks)
    return (
        f'<svg viewBox="0 0 {frame.width:g} {frame.height:g}" role="img" aria-label="{escape(label)}" '
        f'font-size="{SIZE:g}" fill="{INK}">\n{body}\n</svg>'
    )


def text(x: float, y: float, words: str, anchor: str = "middle", colour: str = INK, more: str = "") -> str:
    """Return a text at a position of the figure."""
    attributes = f'x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{colour}"'
    return f"<text {attributes}{' ' if more else ''}{more}>{escape(words)}</text>"


def line(points: Iterable[tuple[float, float]], colour: str = INK, width: float = 1.4, dash: str = "") -> str:
    """Return a line through positions of the figure."""
    at = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    dashes = f' stroke-dasharray="{dash}"' if dash else ""
    return f'<polyline points="{at}" fill="none" stroke="{colour}" stroke-width="{width:g}"{dashes}/>'


def curve(frame: PlotArea, x: Sequence[float], y: Sequence[float], colour: str = INK, dash: str = "") -> str:
    """Return a line through points given as numbers on the axes."""
    return line(((frame.across(a), frame.up(b)) for a, b in zip(x, y, strict=True)), colour, 1.5, dash)


def band(frame: PlotArea, x: Sequence[float], low: Sequence[float], high: Sequence[float], colour: str) -> str:
    """Return the area between two curves."""
    forth = [f"{frame.across(a):.1f},{frame.up(b):.1f}" for a, b in zip(x, high, strict=True)]
    back = [f"{frame.across(a):.1f},{frame.up(b):.1f}" for a, b in zip(x, low, strict=True)]
    return f'<polygon points="{" ".join(forth + back[::-1])}" fill="{colour}"/>'


def box(x: float, y: float, width: float, height: float, colour: str, more: str = "") -> str:
    """Return a rectangle; a negative size is treated as 0."""
    size = f'width="{max(width, 0):.1f}" height="{max(height, 0):.1f}"'
    return f'<rect x="{x:.1f}" y="{y:.1f}" {size} fill="{colour}"{" " if more else ""}{more}/>'


def dots(positions: Iterable[tuple[float, float]], colour: str, radius: float = 2.2) -> str:
    """Return dots at positions of the figure."""
    # A line of length 0 with round ends is a dot, with a quarter of the bytes of a circle.
    path = "".join(f"M{x:.1f} {y:.1f}h0" for x, y in positions)
    return f'<path d="{path}" stroke="{colour}" stroke-width="{2 * radius:g}" stroke-linecap="round" fill="none"/>'


def marker(frame: PlotArea, value: float, words: str, colour: str, dash: str, row: int = 0) -> str:
    """Return a vertical line with its name above it, inside the figure; a name in row 1 is higher."""
    x = frame.across(value)
    half = 0.5 * text_width(words) * 1.05 + 1
    # Not over the numbers of the y axis, whose uppermost may be as high as the name.
    middle = min(max(x, frame.left - 4 + half), frame.width - half)
    name = text(middle, frame.top - 6 - 14 * row, words, colour=colour, more='font-weight="600"')
    return line([(x, frame.ground), (x, frame.top - 3 - 14 * row)], colour, 1.5, dash) + "\n" + name


def limit_markers(frame: PlotArea, limits: Iterable[tuple[float | None, str]]) -> list[str]:
    """Return the vertical lines of limits that are given, with their names and values, which keep off each other."""
    known = sorted((value, f"{name} {format_numbers.plain(value)}") for value, name in limits if value is not None)
    halves = [0.5 * text_width(words) * 1.05 + 1 for _, words in known]
    middles = [max(frame.across(value), frame.left - 4 + half) for (value, _), half in zip(known, halves, strict=True)]
    for i in range(1, len(known)):
        middles[i] = max(middles[i], middles[i - 1] + halves[i - 1] + halves[i] + 6)
    for i in reversed(range(len(known))):
        last = frame.width if i + 1 == len(known) else middles[i + 1] - halves[i + 1] - 6
        middles[i] = min(middles[i], last - halves[i])
    marks = []
    for (value, words), middle in zip(known, middles, strict=True):
        x = frame.across(value)
        marks.append(line([(x, frame.ground), (x, frame.top - 3)], LIMIT, 1.5, "7 4"))
        marks.append(text(middle, frame.top - 6, words, colour=LIMIT, more='font-weight="600"'))
    return marks


def axis_x(frame: PlotArea, label: str = "", ticks: Sequence[tuple[float, str]] | None = None) -> str:
    """Return the x axis: line, ticks, numbers, label."""
    marks = [line([(frame.left, frame.ground), (frame.width - frame.right, frame.ground)], MUTED, 1)]
    for value, words in ticks or _fitting(frame):
        x = frame.across(value)
        marks.append(line([(x, frame.ground), (x, frame.ground + 4)], MUTED, 1))
        marks.append(text(x, frame.ground + 17, words, colour=MUTED))
    if label:
        middle = 0.5 * (frame.left + frame.width - frame.right)
        room = 2 * min(middle, frame.width - middle)
        marks.append(text(middle, frame.height - 8, shortened(label, room)))
    return "\n".join(marks)


def axis_y(frame: PlotArea, label: str, ticks: Sequence[tuple[float, str]] | None = None) -> str:
    """Return the y axis: grid, numbers, label."""
    marks = []
    for value, words in ticks or labelled(*frame.y, 4):
        y = frame.up(value)
        marks.append(line([(frame.left, y), (frame.width - frame.right, y)], GRID, 1))
        marks.append(text(frame.left - 6, y + 4, words, "end", MUTED))
    middle = 0.5 * (frame.top + frame.ground)
    label = shortened(label, frame.ground - frame.top + 20)
    marks.append(text(13, middle, label, more=f'transform="rotate(-90 13 {middle:.1f})"'))
    return "\n".join(marks)


def unit_suffix(unit: str) -> str:
    """Return the unit with a space before it; empty for a number without unit."""
    return "" if unit in ("", "1") else f" {unit}"


def around(values: list[float]) -> tuple[float, float]:
    """Return the ends of an axis that shows all values, with a margin."""
    low, high = min(values), max(values)
    room = 0.04 * (high - low) or 0.02 * abs(low) or 1.0
    return low - room, high + room


def with_near(values: list[float], limits: Iterable[float]) -> tuple[list[float], list[float]]:
    """Return the values with the limits near them, which an axis then shows, and the limits that are far from them."""
    low, high = min(values), max(values)
    room = NEAR * (high - low or abs(high) or 1.0)
    near, far = list[float](), list[float]()
    for limit in limits:
        (near if low - room <= limit <= high + room else far).append(limit)
    return [*values, *near], far


def axis_name(name: str, unit: str) -> str:
    """Return the label of an axis."""
    return name if unit in ("", "1") else f"{name} [{unit}]"


def density_name(unit: str) -> str:
    """Return the label of a density axis."""
    bare = unit in ("", "1")
    return "density" if bare else f"density [1/{unit}]" if " " not in unit else f"density [1/({unit})]"


def y_room(low: float, high: float) -> float:
    """Return the margin that the numbers and the label of a y axis need."""
    return 30.0 + max((text_width(words) for _, words in labelled(low, high, 4)), default=0.0)


def shortened(words: str, room: float) -> str:
    """Return a text that fits into a width; a long text loses its middle."""
    most = max(int(room / (_WIDTH_OF_A_LETTER * SIZE)), 4)
    return words if len(words) <= most else f"{words[: most - most // 3 - 1]}…{words[-(most // 3) :]}"


def text_width(words: str) -> float:
    """Return the approximate width of a text."""
    return _WIDTH_OF_A_LETTER * SIZE * len(words)


def labelled(low: float, high: float, count: int) -> list[tuple[float, str]]:
    """Return about `count` round numbers between `low` and `high`, each with its text."""
    if not 0 < (high - low) / count < math.inf:
        return []
    about = (high - low) / count
    power = 10.0 ** math.floor(math.log10(about))
    step = power * next(factor for factor in (1, 2, 5, 10) if factor * power >= about * (1 - 1e-9))
    first = math.ceil(low / step - 1e-9)
    values = [step * i for i in range(first, math.floor(high / step + 1e-9) + 1)]
    largest = max((abs(v) for v in values), default=0.0)
    if largest and (largest >= 1e6 or largest < 1e-4):
        # Enough digits to distinguish neighbours.
        digits = max(0, math.floor(math.log10(largest)) - math.floor(math.log10(step) + 1e-9))
        return [(v, "0" if v == 0 else f"{v:.{min(digits, 15)}e}") for v in values]
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    return [(v, f"{v:.{decimals}f}".replace("-", "−") if abs(v) > step / 2 else "0") for v in values]


def _fitting(frame: PlotArea) -> list[tuple[float, str]]:
    """Return round numbers whose texts fit below the x axis."""
    room = frame.width - frame.left - frame.right
    for count in (8, 6, 4, 3, 2):
        ticks = labelled(*frame.x, count)
        if sum(text_width(words) + 14 for _, words in ticks) < room:
            return ticks
    return ticks[:1]  # none in a range that is no number


def is_sliver(low: float, high: float, frame: PlotArea, least: float = SLIVER) -> bool:
    """Return whether the range from `low` to `high` takes less than a share `least` of the width of a figure."""
    return 0 < high - low < least * (frame.x[1] - frame.x[0])


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
            box(left - 8, area.top - 18, right - left + 16, area.ground - area.top + 42, PAPER),
            line(corners, MUTED, 0.8),
            *marks,
            axis_x(area),
            text(0.5 * (left + right), area.top - 6, "enlarged", colour=MUTED),
        ]
    )
