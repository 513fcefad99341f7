"""A response against its strongest inputs: the points, the slope, and the mean over groups of samples."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from reporting.arrays import Array, Columns, extremes, random_rows, some_of
from reporting.sensitivity.influence import ResponseSensitivity

STRONGEST = 2
POINTS, EXTREMES = 800, 25  # points in random order; points of the smallest values, and as many of the largest
GROUPS, FEWEST = 12, 60  # groups of equal size for means; fewest samples for them


@dataclass(frozen=True)
class Scatter:
    """A response against one input."""

    variable: str
    share: float | None  # of the response's variance
    n: int  # samples with a value of both quantities
    # input of the points to draw: all samples, or 800 in random order and those of the 25 smallest and largest
    # responses
    x: tuple[float, ...]
    y: tuple[float, ...]  # response of these points
    # of the least-squares line through at most 200,000 random samples, in the response's unit per unit of the input
    slope: float | None
    # of these over twelve groups of equal size, from the smallest to the largest inputs; empty below 60 samples
    mean_x: tuple[float, ...]
    mean_y: tuple[float, ...]


def scatters(
    sensitivity: ResponseSensitivity | None, inputs: Mapping[str, Array], values: Array
) -> tuple[Scatter, ...]:
    """Return a response, NaN where missing, against its two strongest inputs, by share or else by correlation."""
    columns = Columns.of(inputs)
    ranked = () if sensitivity is None else sensitivity.ranked
    shares = {influence.variable: influence.share for influence in ranked if influence.share is not None}
    found = []
    for variable in list(shares or sorted(columns, key=lambda name: -_correlation(columns[name], values)))[:STRONGEST]:
        known = columns.only([variable]).finite
        both = np.isfinite(values) if known is None else np.isfinite(values) & known
        some, n = np.sort(some_of(both)), int(np.count_nonzero(both))
        x, y = columns.take(variable, some), values[some]
        if y.size < 2 or np.ptp(x) == 0:
            continue
        rows = _shown(values) if n == values.size else np.flatnonzero(both)[_shown(values[both])]
        mean_x, mean_y = _means(x, y)
        found.append(
            Scatter(
                variable,
                shares.get(variable),
                n,
                tuple(columns.take(variable, rows).tolist()),
                tuple(values[rows].tolist()),
                _slope(x, y),
                mean_x,
                mean_y,
            )
        )
    return tuple(found)


def _correlation(x: Array, y: Array) -> float:
    """Return the absolute correlation of an input and a response; 0 if it is undefined."""
    both = np.isfinite(x) & np.isfinite(y)
    x, y = x[both], y[both]
    if x.size < 2 or np.ptp(x) == 0 or np.ptp(y) == 0:
        return 0.0
    with np.errstate(all="ignore"):
        found = float(abs(np.corrcoef(x, y)[0, 1]))
    return found if np.isfinite(found) else 0.0


def _shown(y: Array) -> NDArray[np.intp]:
    """Return the rows to draw, in order; the same values give the same rows."""
    if y.size <= POINTS + 2 * EXTREMES:
        return np.arange(y.size)
    ends = [extremes(y, EXTREMES, largest=largest) for largest in (False, True)]
    return np.unique(np.concatenate([random_rows(y.size)[:POINTS], *ends]))


def _slope(x: Array, y: Array) -> float | None:
    """Return the slope of the straight line through points; None if it is not finite."""
    scale = float(np.max(np.abs(x)))
    with np.errstate(all="ignore"):
        # Scaled, so that the squares of very large or small inputs do not overflow or vanish.
        from_middle = (x - x.mean()) / scale
        slope = float(from_middle @ (y - y.mean()) / (from_middle @ from_middle) / scale)
    return slope if np.isfinite(slope) else None


def _means(x: Array, y: Array) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the means of input and response over groups of equal size, in the order of the input."""
    if x.size < FEWEST:
        return (), ()
    order = np.argsort(x, kind="stable")
    groups = np.array_split(order, GROUPS)
    with np.errstate(all="ignore"):
        means = [(float(np.mean(x[g])), float(np.mean(y[g]))) for g in groups]
    kept = [pair for pair in means if np.all(np.isfinite(pair))]
    return tuple(a for a, _ in kept), tuple(b for _, b in kept)
