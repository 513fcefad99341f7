"""How a speed develops: to rest, to and fro, slower and slower, steadily, or ever faster."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from engine.arrays import Array, Integers

STEADY = 0.02  # relative change of the speed over the time observed, below which it is steady
LINEAR = 0.8  # share of the first half's loss of speed that the second half repeats; with dry friction it is 1


@dataclass(frozen=True)
class SpeedCourse:
    """How a speed develops."""

    # swings to and fro, turns back once, slows down, is steady, or gets faster
    kind: Literal["swings", "turns back", "slows", "steady", "faster"]
    rest: float | None = None  # time at which it is expected to come to rest, if this can be told
    period: float | None = None  # for a swing
    loss: float | None = None  # for a swing, the share of its amplitude lost per period, if more than one was seen


def course_of(time: Array, speed: Array, window: float, drift: float) -> SpeedCourse:
    """Return how a speed develops; `time` and `speed` have shape (n,), n >= 3.

    A body is at rest if it moves by no more than `drift` in the time `window`.
    """
    turns = turns_of(speed)
    if turns.size:
        return _swing(time, speed, turns, window, drift)
    first, middle, last = np.interp([time[0], 0.5 * (time[0] + time[-1]), time[-1]], time, np.abs(speed))
    if abs(last - first) <= STEADY * max(first, last):
        return SpeedCourse("steady")
    if last > first:
        return SpeedCourse("faster")
    return SpeedCourse("slows", _stop(time, first, middle, last, drift / window))


def turns_of(speed: Array) -> Integers:
    """Return the indices of the values after which a speed changes its sign."""
    return np.flatnonzero(np.sign(speed[:-1]) * np.sign(speed[1:]) < 0.0)


def _stop(time: Array, first: float, middle: float, last: float, slow: float) -> float | None:
    """Return when a falling speed will be below ``slow``: falling linearly, or by equal shares in equal times."""
    half, ratio = 0.5 * (time[-1] - time[0]), (middle - last) / (first - middle) if first > middle else np.inf
    if ratio > 1.0 / LINEAR:
        return None  # it falls faster and faster and will soon reverse
    if ratio >= LINEAR:
        return float(time[-1] + max(last - slow, 0.0) / (middle - last) * half)
    level = last - (middle - last) * ratio / (1.0 - ratio)  # its limit
    if level >= slow:
        return None
    return float(time[-1] + half * max(np.log((slow - level) / (last - level)) / np.log(ratio), 0.0))


def _swing(time: Array, speed: Array, turns: Integers, window: float, drift: float) -> SpeedCourse:
    """Return the period and loss of a speed that changes its sign, and when it will be at rest."""
    zeros = time[turns] + (time[turns + 1] - time[turns]) * speed[turns] / (speed[turns] - speed[turns + 1])
    if turns.size < 2:
        return SpeedCourse("turns back")
    half = float(np.diff(zeros).mean())
    tops = np.array([np.abs(speed[a + 1 : b + 1]).max() for a, b in pairwise(turns)])
    if tops.size < 2:
        return SpeedCourse("swings", None, 2 * half)
    left = float((tops[-1] / tops[0]) ** (1.0 / (tops.size - 1)))
    loss = 1.0 - left**2  # a period is two halves
    if loss <= STEADY:
        return SpeedCourse("swings", None, 2 * half, max(loss, 0.0))
    # a swing shorter than the window moves by 2 half / pi times its top speed, and never further
    slow = max(drift / window, drift * np.pi / (2 * half))
    halves = max(np.log(slow / tops[-1]) / np.log(left), 0.0)
    return SpeedCourse("swings", float(zeros[-1] + halves * half), 2 * half, loss)
