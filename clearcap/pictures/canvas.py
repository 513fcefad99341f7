"""Lines, areas and words on a canvas, with the projection of the world onto it and the placing of words.

Positions are in points of the canvas, from its upper left corner; nothing else is needed to draw a sketch.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from clearcap.pictures.view import View
from engine.arrays import Array
from reporting.spec import DrawnLine, DrawnWords, LegendEntry, MechanismDrawing, Points

DIRECTIONS = 16
DISTANCES = (4.0, 12.0, 22.0, 34.0, 50.0, 70.0, 95.0, 125.0, 160.0, 200.0)
CROSSED = 6.0  # a point of a line under a label costs as much as this distance
GAP = 2.0  # least distance between two labels
WIDTH, LOWEST, HIGHEST, TEXT = 480.0, 220.0, 460.0, 13.0
MARGIN = 38.0  # around the bodies, for arrows and names
LETTER, LINE = 0.64, 1.2  # width of a letter and height of a line, in sizes of the text
NAME, NAMES = 24, 4  # largest number of letters of a name, and of names at one place
FAR = 0.5  # of the bodies' size beyond them; points further away are moved to this distance


@dataclass
class SketchCanvas:
    """A sketch under construction: the projection of the world onto the canvas, and everything added so far."""

    view: View
    corner: Array
    scale: float
    height: float
    reach: tuple[Array, Array]
    areas: list[tuple[Points, str]] = field(default_factory=list)
    strokes: list[DrawnLine] = field(default_factory=list)
    dots: list[tuple[float, float, str]] = field(default_factory=list)
    labels: dict[tuple[float, float, float, float], list[tuple[str, str]]] = field(
        default_factory=lambda: defaultdict(list)
    )
    bodies: list[tuple[Array, str, str]] = field(default_factory=list)
    levels: dict[tuple[float, ...], list[tuple[float, ...]]] = field(default_factory=dict)

    def on_canvas(self, points: Array) -> Array:
        """Project points of the world onto the canvas; points far away are moved to its edge."""
        flat = np.clip(self.view.project(points), *self.reach)
        return np.asarray((flat - self.corner) * [self.scale, -self.scale] + [MARGIN, self.height - MARGIN])

    def area(self, outline: Array, colour: str) -> Array:
        """Add a body by its outline in the world; return the outline's corners on the canvas."""
        corners = self.on_canvas(outline)
        self.areas.append((_rounded(corners), colour))
        return corners

    def body_name(self, corners: Array, name: str, colour: str) -> None:
        """Add the name of a body whose outline has these corners."""
        self.bodies.append((corners.mean(axis=0), name, colour))

    def stroke(self, points: Array, colour: str, style: str = "thin") -> None:
        """Add a line; points outside of the canvas are moved to its edge."""
        inside = np.clip(points, 2.0, [WIDTH - 2.0, self.height - 2.0])
        self.strokes.append(DrawnLine(_rounded(inside), colour, style))

    def dot(self, at: Array, colour: str) -> None:
        """Add a dot."""
        self.dots.append((round(float(at[0]), 1), round(float(at[1]), 1), colour))

    def name(self, at: Array, away: Array, name: str, colour: str) -> None:
        """Add a name at a place; names at the same place are written below each other."""
        at = np.clip(at, 2.0, [WIDTH - 2.0, self.height - 2.0])
        key = (round(float(at[0]), 1), round(float(at[1]), 1), round(float(away[0]), 3), round(float(away[1]), 3))
        self.labels[key].append((name, colour))

    def sketch(self, legend: tuple[LegendEntry, ...]) -> MechanismDrawing:
        """Return the finished sketch, with its words placed where there is room."""
        words, lowest = self._words()
        drawn = (tuple(self.areas), tuple(self.strokes), tuple(self.dots))
        return MechanismDrawing(WIDTH, max(self.height, lowest), TEXT, *drawn, words, legend)

    def _words(self) -> tuple[tuple[DrawnWords, ...], float]:
        """Return all names, first of places and then of bodies, and the position of their lowest end."""
        texts, labels = [], []
        for (x, y, *away), named in self.labels.items():
            names = [_short(name) for name, _ in named]
            lines = (*names[:NAMES], *([f"and {len(names) - NAMES} more"] if len(names) > NAMES else []))
            texts.append((lines, named[0][1], True))
            labels.append(Label(np.array([x, y]), _size(lines), np.array(away)))
        for middle, name, colour in self.bodies:
            texts.append(((_short(name),), colour, False))
            labels.append(Label(middle, _size((_short(name),)), np.zeros(2)))
        marked = [_along(stroke.points) for stroke in self.strokes if stroke.style != "thin"]
        marked += [np.array([dot[:2] for dot in self.dots]).reshape(-1, 2)]
        centres = place_labels(labels, np.vstack(marked), np.array([WIDTH, self.height]))
        words = []
        for label, centre, (lines, colour, bold) in zip(labels, centres, texts, strict=True):
            words.append(DrawnWords(round(float(centre[0]), 1), round(float(centre[1]), 1), lines, colour, bold))
            outside = np.abs(label.anchor - centre) - 0.5 * np.array(label.size)
            if bold and float(outside.max()) > 1.2 * TEXT:  # a leader line shows what a distant name belongs to
                half = 0.5 * np.array(label.size)
                self.stroke(np.array([np.clip(label.anchor, centre - half, centre + half), label.anchor]), colour)
        ends = [float(c[1]) + 0.5 * label.size[1] + 4 for c, label in zip(centres, labels, strict=True)]
        return tuple(words), max(ends, default=0.0)


def canvas_around(view: View, bodies: list[Array], ends: list[Array]) -> SketchCanvas:
    """Return an empty canvas with room for bodies, and for ends of measurements that are near; points (k, 2)."""
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
    return SketchCanvas(view, low - 0.5 * room / scale, scale, height, reach)


def _size(lines: tuple[str, ...]) -> tuple[float, float]:
    return LETTER * TEXT * max(map(len, lines)) + 4, LINE * TEXT * len(lines) + 2


def _short(name: str) -> str:
    """Return a name, shortened in the middle if it is long."""
    return name if len(name) <= NAME else f"{name[: NAME - 9]}…{name[-8:]}"


def _along(points: Points) -> Array:
    """Return points along a line, about four units of the canvas apart."""
    corners = np.array(points)
    parts = [np.linspace(a, b, max(int(np.linalg.norm(b - a) / 4), 2)) for a, b in pairwise(corners)]
    return np.vstack(parts or [corners])


def _rounded(points: Array) -> Points:
    """Return points rounded to a tenth, without successive duplicates."""
    found = np.round(points, 1) + 0.0
    kept = np.concatenate([[True], np.any(np.diff(found, axis=0) != 0, axis=1)])
    return tuple((x, y) for x, y in found[kept].tolist())


class Label(NamedTuple):
    """Words to place."""

    anchor: Array  # the point that they name, (2,)
    size: tuple[float, float]  # width and height
    away: Array  # preferred direction from the anchor, (2,)


def place_labels(labels: Sequence[Label], marked: Array, canvas: Array) -> Array:
    """Return the centre of each label, shape (n, 2), such that no two of them overlap.

    A label without room on the canvas, whose size is (2,), is placed below it, under earlier labels without room. Lines
    through the points ``marked``, (m, 2), should not be covered.
    """
    centres, halves = np.zeros((0, 2)), np.zeros((0, 2))
    for label in labels:
        half = 0.5 * np.array(label.size)
        costs, places = _candidates(label, half)
        inside = np.all((places >= half) & (places <= canvas - half), axis=1)
        free = np.any(np.abs(places[:, None] - centres) >= half + halves + GAP, axis=2).all(axis=1)
        covered = np.all(np.abs(places[:, None] - marked) < half, axis=2).sum(axis=1)
        costs = np.where(inside & free, costs + CROSSED * covered, np.inf)
        best = places[np.argmin(costs)]
        if np.isinf(costs.min()):
            floor = np.max(centres[:, 1] + halves[:, 1], initial=canvas[1])
            best = np.array([half[0], floor + GAP + half[1]])
        centres, halves = np.vstack([centres, best]), np.vstack([halves, half])
    return centres


def _candidates(label: Label, half: Array) -> tuple[Array, Array]:
    """Return costs (k,) and centres (k, 2) of places around the anchor; the preferred direction costs least."""
    first = float(np.arctan2(label.away[1], label.away[0])) if label.away.any() else -0.5 * np.pi
    turn = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    direction = np.stack([np.cos(first + turn), np.sin(first + turn)], axis=1)
    reach = np.min(half / np.maximum(np.abs(direction), 1e-9), axis=1)
    distance = np.array(DISTANCES)[:, None]
    centres = label.anchor + (reach + distance)[:, :, None] * direction
    return (distance + 3.0 * (1 - np.cos(turn))).ravel(), centres.reshape(-1, 2)
