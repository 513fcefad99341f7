"""A drawing of the mechanism as plain data, which the caller passes to a report."""

from dataclasses import dataclass
from typing import NamedTuple

Points = tuple[tuple[float, float], ...]


class DrawnLine(NamedTuple):
    """A line through points; ``style`` is "thin", "thick", "dashed" or "arrow", with its head at the last point."""

    points: Points
    colour: str
    style: str


class DrawnWords(NamedTuple):
    """Lines of text centred at (x, y), one below the other; ``bold`` for the name of a response."""

    x: float
    y: float
    lines: tuple[str, ...]
    colour: str
    bold: bool


class LegendEntry(NamedTuple):
    """A response: its name, its title, what it measures or where, and its colour; empty if it has no place."""

    name: str
    title: str
    value: str
    colour: str


@dataclass(frozen=True)
class MechanismDrawing:
    """The mechanism and what its responses measure, on a canvas with the origin at its upper left corner."""

    width: float  # of the canvas
    height: float
    text: float  # font size
    areas: tuple[tuple[Points, str], ...]  # outlines of moving bodies, and their colours "#rrggbb"
    strokes: tuple[DrawnLine, ...]
    dots: tuple[tuple[float, float, str], ...]  # x, y, colour
    words: tuple[DrawnWords, ...]
    legend: tuple[LegendEntry, ...]  # one entry per response
