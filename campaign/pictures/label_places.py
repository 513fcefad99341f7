"""Place labels near their anchors, on the canvas, without overlapping each other, and off lines if there is room."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from engine.arrays import Array

DIRECTIONS = 16
DISTANCES = (4.0, 12.0, 22.0, 34.0, 50.0, 70.0, 95.0, 125.0, 160.0, 200.0)
CROSSED = 6.0  # a point of a line under a label costs as much as this distance
GAP = 2.0  # least distance between two labels


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
