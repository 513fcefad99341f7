"""A mechanism at its start, with an arrow and a name for what each response measures, as lines on a canvas.

Positions are in points of the canvas, from its upper left corner; whoever draws a sketch needs nothing else.
"""

from collections import defaultdict
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from campaign.pictures.body_shapes import body_shape
from campaign.pictures.label_places import Label, place_labels
from campaign.pictures.measurements import Measurement, StartContact, contacts_at_start, measurements
from campaign.pictures.style import FORCE, MUTED, PALETTE
from campaign.pictures.view import View, choose_view, start_rotation
from engine import Mechanism
from engine.arrays import Array

WIDTH, LOWEST, HIGHEST, TEXT = 480.0, 220.0, 460.0, 13.0
MARGIN = 38.0  # around the bodies, for arrows and names
LETTER, LINE = 0.64, 1.2  # width of a letter and height of a line, in sizes of the text
NAME, NAMES = 24, 4  # letters of a name, and names at one arrow, that are shown
LEVEL, ARROW, SHORT = 16.0, 44.0, 14.0  # distance of parallel arrows; length of a force's; shortest with both heads
LEVELS = 7  # of parallel arrows; further ones lie on the first
LEAST_SEEN = 0.3  # projected length of a unit vector: what is shorter is along the line of sight
FAR = 0.5  # of the bodies' size beyond them: what is measured from further away is cut there

Points = tuple[tuple[float, float], ...]


class Stroke(NamedTuple):
    """A line through points; ``style`` is "thin", "thick", "dashed" or "arrow", with its head at the last point."""

    points: Points
    colour: str
    style: str


class Word(NamedTuple):
    """Words with their middle at (x, y), one line below the other; ``bold`` for the name of a response."""

    x: float
    y: float
    lines: tuple[str, ...]
    colour: str
    bold: bool


@dataclass(frozen=True)
class Sketch:
    """What is drawn.

    Attributes
    ----------
    width, height, text : float
        Size of the canvas and of its text.
    areas : tuple of (points, colour)
        Bodies that move.
    strokes : tuple of Stroke
    dots : tuple of (x, y, colour)
    words : tuple of Word
    legend : tuple of (name, title, value, colour)
        Of every response; the colour is empty if it has no place in the picture.
    """

    width: float
    height: float
    text: float
    areas: tuple[tuple[Points, str], ...]
    strokes: tuple[Stroke, ...]
    dots: tuple[tuple[float, float, str], ...]
    words: tuple[Word, ...]
    legend: tuple[tuple[str, str, str, str], ...]


@dataclass
class _Drawing:
    """A sketch in the making: how the world lies on the canvas, and what is there so far."""

    view: View
    corner: Array
    scale: float
    height: float
    reach: tuple[Array, Array]
    areas: list[tuple[Points, str]] = field(default_factory=list)
    strokes: list[Stroke] = field(default_factory=list)
    dots: list[tuple[float, float, str]] = field(default_factory=list)
    labels: dict[tuple[float, float, float, float], list[tuple[str, str]]] = field(
        default_factory=lambda: defaultdict(list)
    )
    bodies: list[tuple[Array, str, str]] = field(default_factory=list)
    levels: dict[tuple[float, ...], list[tuple[float, ...]]] = field(default_factory=dict)

    def on_canvas(self, points: Array) -> Array:
        """Return points of the world on the canvas, those far away at its edge."""
        flat = np.clip(self.view.project(points), *self.reach)
        return np.asarray((flat - self.corner) * [self.scale, -self.scale] + [MARGIN, self.height - MARGIN])

    def stroke(self, points: Array, colour: str, style: str = "thin") -> None:
        """Add a line; what leaves the canvas is at its edge."""
        inside = np.clip(points, 2.0, [WIDTH - 2.0, self.height - 2.0])
        self.strokes.append(Stroke(_rounded(inside), colour, style))

    def name(self, at: Array, away: Array, name: str, colour: str) -> None:
        """Add a name at a place; names at one place stand below each other."""
        at = np.clip(at, 2.0, [WIDTH - 2.0, self.height - 2.0])
        key = (round(float(at[0]), 1), round(float(at[1]), 1), round(float(away[0]), 3), round(float(away[1]), 3))
        self.labels[key].append((name, colour))


def sketch_mechanism(mechanism: Mechanism) -> Sketch:
    """Return the sketch of a mechanism with what its responses measure.

    Parameters
    ----------
    mechanism : Mechanism
        What to draw.
    """
    view, contacts = choose_view(mechanism), contacts_at_start(mechanism)
    drawn = list(measurements(mechanism, contacts))
    drawing = _bodies(mechanism, view, contacts, [m for m in drawn if m.kind != "none"])
    legend = []
    for i, measurement in enumerate(drawn):
        colour = FORCE if measurement.force else PALETTE[i % len(PALETTE)]
        hidden = measurement.kind != "none" and _draw(drawing, measurement, colour)
        value = f"{measurement.value}, along the line of sight" if hidden else measurement.value
        legend.append((measurement.name, measurement.title, value, "" if measurement.kind == "none" else colour))
    words, lowest = _words(drawing)
    return Sketch(
        WIDTH,
        max(drawing.height, lowest),
        TEXT,
        tuple(drawing.areas),
        tuple(drawing.strokes),
        tuple(drawing.dots),
        words,
        tuple(legend),
    )


def _bodies(
    mechanism: Mechanism, view: View, contacts: dict[str, StartContact], measured: list[Measurement]
) -> _Drawing:
    """Return the drawing with the bodies; the canvas holds them, and what is measured near them."""
    shapes = []
    extent = float(np.ptp([contact.point for contact in contacts.values()] or np.zeros((1, 3)), axis=0).max())
    for name in mechanism.bodies:
        origin, rotation = np.array(mechanism.bodies[name].origin), start_rotation(mechanism, name)
        touched = {contact: (at.point[None] - origin) @ rotation for contact, at in contacts.items()}
        shape = body_shape(mechanism, name, view, touched, extent)
        outline, *lines = [origin + p @ rotation.T for p in (shape.outline, *shape.lines, *shape.faces)]
        shapes.append((name, outline, lines))
    fixed = [name for name, body in mechanism.bodies.items() if body.fixed]
    seen = [view.project(p) for name, outline, lines in shapes for p in ([] if name in fixed else [outline]) + lines]
    ends = [view.project(np.array([m.start, m.end if m.kind in ("length", "span") else m.start])) for m in measured]
    drawing = _canvas(view, [p for p in seen if len(p)], ends)
    moving = [name for name, _, _ in shapes if name not in fixed]
    for name, outline, lines in shapes:
        if name in moving and len(outline):
            colour, corners = PALETTE[moving.index(name) % len(PALETTE)], drawing.on_canvas(outline)
            drawing.areas.append((_rounded(corners), colour))
            drawing.bodies.append((corners.mean(axis=0), name, colour))
        for line in lines:
            drawing.stroke(drawing.on_canvas(line), MUTED)
    return drawing


def _canvas(view: View, bodies: list[Array], ends: list[Array]) -> _Drawing:
    """Return an empty drawing whose canvas holds the bodies, and the ends of what is measured unless far away."""
    corners = np.vstack(bodies or ends or [np.zeros((1, 2))])
    low, high = corners.min(axis=0), corners.max(axis=0)
    beyond = FAR * (float((high - low).max()) or 1.0)
    reach = (low - beyond, high + beyond)
    corners = np.vstack([corners, *(np.clip(each, *reach) for each in ends)])
    low, high = corners.min(axis=0), corners.max(axis=0)
    size = np.maximum(high - low, 1e-9 * (np.abs(corners).max() or 1.0) + 1e-300)
    scale = min((WIDTH - 2 * MARGIN) / size[0], (HIGHEST - 2 * MARGIN) / size[1])
    height = max(scale * size[1] + 2 * MARGIN, LOWEST)
    room = np.array([WIDTH, height]) - 2 * MARGIN - scale * size
    return _Drawing(view, low - 0.5 * room / scale, scale, height, reach)


def _draw(drawing: _Drawing, measurement: Measurement, colour: str) -> bool:
    """Draw what a response measures; return whether its direction is along the line of sight, where a dot stands."""
    start, end, point = (drawing.on_canvas(p) for p in (measurement.start, measurement.end, measurement.point))
    true = float(np.linalg.norm(measurement.end - measurement.start))
    seen = drawing.view.project(measurement.end - measurement.start) * [1.0, -1.0]
    length = float(np.linalg.norm(seen))
    if measurement.kind == "turn":
        _turn(drawing, start, measurement.name, colour, facing=length < LEAST_SEEN * true)
        return False
    if measurement.kind == "point" or length < LEAST_SEEN * true or length == 0.0:
        _dot(drawing, point, colour)
        drawing.name(point, np.array([0.0, -1.0]), measurement.name, colour)
        return measurement.kind not in ("point", "span") and true > 0.0
    along = seen / length
    if measurement.kind == "arrow":
        tip = start + ARROW * along
        drawing.stroke(np.array([start, tip]), colour, "arrow")
        drawing.name(tip, along, measurement.name, colour)
    elif measurement.kind == "span":
        drawing.stroke(np.array([start, end]), colour, "thick")
        drawing.name(0.5 * (start + end), np.array([-along[1], along[0]]), measurement.name, colour)
    else:
        _length(drawing, (start, end, point), along, measurement.name, colour)
    return False


def _length(drawing: _Drawing, places: tuple[Array, Array, Array], along: Array, name: str, colour: str) -> None:
    """Draw a length with its measured point; lengths from one point along one line stand beside each other."""
    start, end, point = places
    across = np.array([-along[1], along[0]])
    key = tuple(np.round([*start, *np.abs(along)], 2))
    ends = drawing.levels.setdefault(key, [])
    end_here = tuple(np.round([*end, *point], 2))
    if end_here not in ends:  # otherwise it is the same arrow
        ends.append(end_here)
    level = ends.index(end_here) % LEVELS
    side = -1.0 if (point - start) @ across > 0 else 1.0
    a, b = (p + side * level * LEVEL * across for p in (start, end))
    near, shifted = min(((start, a), (end, b)), key=lambda pair: float(np.linalg.norm(point - pair[0])))
    for line in (np.array([start, a]), np.array([end, b])):
        drawing.stroke(line, colour)
    drawing.stroke(np.array([point, near, shifted]), colour, "dashed")
    _dot(drawing, point, colour)
    for tick in (a, b):
        drawing.stroke(np.array([tick - 5 * across, tick + 5 * across]), colour)
    if float(np.linalg.norm(b - a)) < SHORT:  # two arrows from outside
        drawing.stroke(np.array([a - 2 * LEVEL * along, a]), colour, "arrow")
        drawing.stroke(np.array([b + 2 * LEVEL * along, b]), colour, "arrow")
        drawing.name(b + 2 * LEVEL * along, along, name, colour)
    else:
        drawing.stroke(np.array([a, b]), colour, "arrow")
        drawing.name(0.5 * (a + b), side * across, name, colour)


def _turn(drawing: _Drawing, centre: Array, name: str, colour: str, *, facing: bool) -> None:
    """Draw a rotation: an arc with a head if its axis points to the viewer, else its centre."""
    if facing:
        angle = np.linspace(-0.2 * np.pi, 1.2 * np.pi, 25)[:, None]
        arc = centre + 0.4 * ARROW * np.hstack([np.cos(angle), -np.sin(angle)])
        drawing.stroke(arc, colour, "arrow")
    _dot(drawing, centre, colour)
    drawing.name(centre + (np.array([0.0, -0.4 * ARROW]) if facing else 0.0), np.array([0.0, -1.0]), name, colour)


def _dot(drawing: _Drawing, at: Array, colour: str) -> None:
    drawing.dots.append((round(float(at[0]), 1), round(float(at[1]), 1), colour))


def _words(drawing: _Drawing) -> tuple[tuple[Word, ...], float]:
    """Return the names of the responses, then those of the bodies, where there is room, and their lowest end."""
    texts, labels = [], []
    for (x, y, *away), named in drawing.labels.items():
        names = [_short(name) for name, _ in named]
        lines = (*names[:NAMES], *([f"and {len(names) - NAMES} more"] if len(names) > NAMES else []))
        texts.append((lines, named[0][1], True))
        labels.append(Label(np.array([x, y]), _size(lines), np.array(away)))
    for middle, name, colour in drawing.bodies:
        texts.append(((_short(name),), colour, False))
        labels.append(Label(middle, _size((_short(name),)), np.zeros(2)))
    marked = [_along(stroke.points) for stroke in drawing.strokes if stroke.style != "thin"]
    marked += [np.array([dot[:2] for dot in drawing.dots]).reshape(-1, 2)]
    centres = place_labels(labels, np.vstack(marked), np.array([WIDTH, drawing.height]))
    words = []
    for label, centre, (lines, colour, bold) in zip(labels, centres, texts, strict=True):
        words.append(Word(round(float(centre[0]), 1), round(float(centre[1]), 1), lines, colour, bold))
        outside = np.abs(label.anchor - centre) - 0.5 * np.array(label.size)
        if bold and float(outside.max()) > 1.2 * TEXT:  # a leader, so that a name far away is not another arrow's
            edge = np.clip(label.anchor, centre - 0.5 * np.array(label.size), centre + 0.5 * np.array(label.size))
            drawing.stroke(np.array([edge, label.anchor]), colour)
    lowest = max((float(c[1]) + 0.5 * label.size[1] + 4 for c, label in zip(centres, labels, strict=True)), default=0.0)
    return tuple(words), lowest


def _size(lines: tuple[str, ...]) -> tuple[float, float]:
    """Return the width and height of words."""
    return LETTER * TEXT * max(map(len, lines)) + 4, LINE * TEXT * len(lines) + 2


def _short(name: str) -> str:
    """Return a name, a long one without its middle."""
    return name if len(name) <= NAME else f"{name[: NAME - 9]}…{name[-8:]}"


def _along(points: Points) -> Array:
    """Return points on a line, a few lengths of the canvas from each other."""
    corners = np.array(points)
    parts = [np.linspace(a, b, max(int(np.linalg.norm(b - a) / 4), 2)) for a, b in pairwise(corners)]
    return np.vstack(parts or [corners])


def _rounded(points: Array) -> Points:
    """Return points to a tenth, without those that then repeat the one before."""
    found = np.round(points, 1) + 0.0
    kept = np.concatenate([[True], np.any(np.diff(found, axis=0) != 0, axis=1)])
    return tuple((x, y) for x, y in found[kept].tolist())
