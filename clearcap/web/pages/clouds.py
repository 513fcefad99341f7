"""Samples as lines over parallel axes, and as dots over two of them: places in a drawing, which style sheets colour."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from reporting.render.svg import labelled, shortened

APART, TOP, TALL, BOTTOM = 92.0, 40.0, 190.0, 24.0  # distance and length of parallel axes, and the room around them
SIDE, GROUND, LEFT, ROOM = 420.0, 320.0, 62.0, 12.0  # of the dots: width, height, and margins
UNDER = 44.0  # room below them for the numbers and the name of the axis


@dataclass(frozen=True)
class Axis:
    """A column as an axis."""

    name: str
    title: str  # name and unit, shortened
    x: float
    least: float
    most: float
    limits: list[float]  # y of those within the axis
    brush: tuple[float, float]  # y and height of its range; no height if it has none


@dataclass(frozen=True)
class Line:
    """A sample as a line."""

    sample: int
    points: str
    at: str  # its places on the axes, from 0 to 1, with commas; empty where it has no value
    is_bad: bool


@dataclass(frozen=True)
class Parallel:
    """All samples as lines over parallel axes."""

    axes: list[Axis]
    lines: list[Line]
    width: float
    top: float = TOP
    bottom: float = TOP + TALL
    height: float = TOP + TALL + BOTTOM


@dataclass(frozen=True)
class Dots:
    """All samples as dots over two columns."""

    columns: tuple[int, int]  # axes of x and y, by their place among the parallel ones
    names: tuple[str, str]  # with units
    dots: list[tuple[int, float, float, bool]]  # sample, x, y, whether it is bad
    ticks: tuple[list[tuple[float, str]], list[tuple[float, str]]]
    limits: tuple[list[float], list[float]]
    left: float = LEFT
    right: float = SIDE - ROOM
    top: float = ROOM
    bottom: float = GROUND - UNDER
    width: float = SIDE
    height: float = GROUND


def parallel_figure(cloud: Mapping[str, Any], ends: Mapping[str, tuple[str, str]]) -> Parallel:
    """Return the lines of a `sample_cloud`; one that has no value on an axis ends before it.

    `ends` are the typed ends of ranges by column; an empty one is no end.
    """
    axes = []
    for i, each in enumerate(cloud["axes"]):
        limits = [_up(value, each) for value in (each["lsl"], each["usl"]) if value is not None]
        inside = [y for y in limits if TOP <= y <= TOP + TALL]
        title = shortened(_titled(each), APART)
        brush = _brush(each, *ends.get(each["name"], ("", "")))
        axes.append(Axis(each["name"], title, APART * (i + 0.5), each["least"], each["most"], inside, brush))
    lines = []
    for row, (sample, is_bad) in enumerate(zip(cloud["sample"], cloud["bad"], strict=True)):
        values = [each["values"][row] for each in cloud["axes"]]
        known = next((i for i, value in enumerate(values) if value is None), len(values))
        shares = [_share(value, each) for value, each in zip(values, cloud["axes"], strict=True) if value is not None]
        points = " ".join(f"{axes[i].x:g},{TOP + TALL * (1 - shares[i]):.1f}" for i in range(known))
        at = ",".join("" if v is None else f"{_share(v, a):.4f}" for v, a in zip(values, cloud["axes"], strict=True))
        lines.append(Line(sample, points, at, is_bad))
    return Parallel(axes, sorted(lines, key=lambda line: line.is_bad), APART * len(axes))


def dots_figure(cloud: Mapping[str, Any], x: str, y: str) -> Dots | None:
    """Return the dots over two columns, by default the first response with limits over the variable that moves it most.

    None with fewer than two columns.
    """
    names = [each["name"] for each in cloud["axes"]]
    if len(names) < 2:
        return None
    limited = [each["name"] for each in cloud["axes"] if each["lsl"] is not None or each["usl"] is not None]
    up = names.index(y) if y in names else names.index(limited[0]) if limited else len(names) - 1
    across = names.index(x) if x in names else _strongest(cloud["axes"], up)
    pair = cloud["axes"][across], cloud["axes"][up]
    found = Dots((across, up), (_titled(pair[0]), _titled(pair[1])), [], ([], []), ([], []))

    def place(value: float, i: int) -> float:
        share = 0.02 + 0.96 * _share(value, pair[i])
        return (
            found.left + share * (found.right - found.left)
            if i == 0
            else found.bottom - share * (found.bottom - found.top)
        )

    for i in (0, 1):
        found.ticks[i].extend((place(v, i), words) for v, words in labelled(pair[i]["least"], pair[i]["most"], 4))
        limits = [v for v in (pair[i]["lsl"], pair[i]["usl"]) if v is not None]
        found.limits[i].extend(place(v, i) for v in limits if pair[i]["least"] <= v <= pair[i]["most"])
    rows = zip(cloud["sample"], pair[0]["values"], pair[1]["values"], cloud["bad"], strict=True)
    shown = [(n, place(a, 0), place(b, 1), is_bad) for n, a, b, is_bad in rows if a is not None and b is not None]
    found.dots.extend(sorted(shown, key=lambda dot: dot[3]))
    return found


def _strongest(axes: Sequence[Mapping[str, Any]], other: int) -> int:
    """Return the axis, of variables if there are any, whose ranks go together best with those of another one."""
    wanted = {i for i, each in enumerate(axes) if each["is_variable"]} - {other} or {*range(len(axes))} - {other}
    values = np.array([[math.nan if v is None else v for v in each["values"]] for each in axes], float)
    known = values[:, np.isfinite(values).all(axis=0)]
    if known.shape[1] < 3:
        return min(wanted)
    ranks = known.argsort(axis=1).argsort(axis=1)
    together: list[float] = np.abs(np.asarray(np.corrcoef(ranks), float)[other]).tolist()
    best: int = max(sorted(wanted), key=together.__getitem__)
    return best


def _brush(axis: Mapping[str, Any], least: str, most: str) -> tuple[float, float]:
    """Return top and height of a range on an axis; no height for one without ends."""
    if not least.strip() and not most.strip():
        return 0.0, 0.0
    ends = (float(text) if text.strip() else axis[key] for text, key in ((least, "least"), (most, "most")))
    low, high = (min(max(_up(value, axis), TOP), TOP + TALL) for value in ends)
    return high, round(max(low - high, 1.0), 1)


def _share(value: float, axis: Mapping[str, Any]) -> float:
    """Return the place of a value on an axis, from 0 at its least to 1."""
    return float((value - axis["least"]) / (axis["most"] - axis["least"]))


def _up(value: float, axis: Mapping[str, Any]) -> float:
    return round(TOP + TALL * (1 - _share(value, axis)), 1)


def _titled(axis: Mapping[str, Any]) -> str:
    return f"{axis['name']} [{axis['unit']}]" if axis["unit"] else str(axis["name"])
