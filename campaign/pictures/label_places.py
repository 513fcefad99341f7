"""Where labels stand: near what they name, on no other label, within the canvas, and off lines where there is room."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from engine.arrays import Array

DIRECTIONS = 16
DISTANCES = (4.0, 12.0, 22.0, 34.0, 50.0, 70.0, 95.0, 125.0, 160.0, 200.0)
CROSSED = 6.0  # a point of a line under a label is as bad as this much distance
GAP = 2.0  # between two labels


class Label(NamedTuple):
    """Words to place.

    Attributes
    ----------
    anchor : ndarray, shape (2,)
        What they name.
    size : (float, float)
        Width and height.
    away : ndarray, shape (2,)
        Direction in which they stand best.
    """

    anchor: Array
    size: tuple[float, float]
    away: Array


def place_labels(labels: Sequence[Label], marked: Array, canvas: tuple[float, float]) -> list[Array]:
    """Return the centre of each label, shape (2,): no two of them overlap.

    A label that finds no room on the canvas stands below it, under the others that found none.

    Parameters
    ----------
    labels : sequence of Label
        The first ones choose first.
    marked : ndarray, shape (m, 2)
        Points of lines that labels should not cover.
    canvas : (float, float)
        Its width and height.
    """
    placed: list[tuple[Array, Array]] = []
    for label in labels:
        half = 0.5 * np.array(label.size)
        choices = [_place(label, half, placed, marked, candidate, canvas) for candidate in _candidates(label, half)]
        best = min((choice for choice in choices if choice is not None), key=lambda choice: choice[0], default=None)
        if best is None:
            floor = max([canvas[1], *(float(centre[1] + size[1]) for centre, size in placed)])
            placed.append((np.array([half[0], floor + GAP + half[1]]), half))
        else:
            placed.append((best[1], half))
    return [centre for centre, _ in placed]


def _candidates(label: Label, half: Array) -> list[tuple[float, Array]]:
    """Return possible centres of a label with their cost: all around the anchor, best where it should stand."""
    first = float(np.arctan2(label.away[1], label.away[0])) if label.away.any() else -0.5 * np.pi
    found = []
    for distance in DISTANCES:
        for i in range(DIRECTIONS):
            turn = 2 * np.pi * i / DIRECTIONS
            direction = np.array([np.cos(first + turn), np.sin(first + turn)])
            reach = min(half[k] / abs(direction[k]) for k in (0, 1) if abs(direction[k]) > 1e-9)
            found.append((distance + 3.0 * (1 - np.cos(turn)), label.anchor + (reach + distance) * direction))
    return found


def _place(
    label: Label,
    half: Array,
    placed: list[tuple[Array, Array]],
    marked: Array,
    candidate: tuple[float, Array],
    canvas: tuple[float, float],
) -> tuple[float, Array] | None:
    """Return the cost of a place and the place; None if it is taken or outside."""
    cost, centre = candidate
    if np.any(centre - half < 0) or np.any(centre + half > canvas):
        return None
    if any(np.all(np.abs(centre - other) < half + size + GAP) for other, size in placed):
        return None
    covered = np.count_nonzero(np.all(np.abs(marked - centre) < half, axis=1)) if len(marked) else 0
    return cost + CROSSED * covered, centre
