"""Histograms with edges on the limits, so that every bar is inside or outside."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from reporting.arrays import Array
from reporting.shape.sorted_sample import SortedSample, sorted_sample

_FEWEST, _MOST = 12, 60
_FARTHEST = 1e6  # bins between the values and a limit that is an edge


@dataclass(frozen=True)
class Histogram:
    """Counts between edges; bin i holds values from ``edges[i]`` to below ``edges[i + 1]``."""

    # Length k + 1, in the unit of the values. The edge at an upper limit is the next number above it, because a value
    # on the limit conforms.
    edges: tuple[float, ...]
    counts: tuple[int, ...]  # length k


def histogram(x: ArrayLike | SortedSample, lsl: float | None = None, usl: float | None = None) -> Histogram | None:
    """Count finite values in 12 to 60 equal bins (Freedman, Diaconis 1981) that end at the limits; None without values.

    With both limits the width is adjusted to divide the distance between them.
    """
    sample = sorted_sample(x)
    values = sample.values
    if values.size == 0:
        return None
    low, high = float(values[0]), float(values[-1])
    width = _width(sample, high - low)
    if lsl is not None and usl is not None:
        between = usl - lsl
        if high == low:
            width = between / _MOST
        elif between > width:  # otherwise the limits become additional edges between wider bins
            width = between / round(between / width)
    middle = low - 0.5 * width if high == low else low  # the bar of a constant is centred on it
    anchor = lsl if lsl is not None else usl if usl is not None else middle
    if not high - low < _FARTHEST * width:
        return None
    if not abs(low - anchor) < _FARTHEST * width:
        anchor = middle
    first, last = math.floor((low - anchor) / width), math.floor((high - anchor) / width) + 1
    edges: Array = anchor + width * np.arange(first, last + 1, dtype=np.float64)
    for limit in (lsl, usl):
        if limit is not None:
            edges = _end_at(edges, limit, width)
    if usl is not None:
        edges = np.where(edges == usl, np.nextafter(usl, math.inf), edges)
    edges = np.unique(edges)
    if edges.size < 2:
        return None
    # By rounding the outermost edges may lie inside the values.
    edges[0], edges[-1] = min(edges[0], low), max(edges[-1], high)
    counts = np.diff([*np.searchsorted(values, edges[:-1]), values.size])
    return Histogram(tuple(edges.tolist()), tuple(counts.tolist()))


def _width(sample: SortedSample, span: float) -> float:
    """Return the width of a bin before it is adjusted to the limits."""
    values = sample.values
    largest = float(max(abs(values[0]), abs(values[-1])))
    # Below this width the edges of a nearly constant response would round to the same number.
    if span <= 1e-9 * largest:
        return 0.02 * largest or 1.0
    quarter, three_quarters = sample.quantiles([0.25, 0.75])
    width = 2 * float(three_quarters - quarter) / math.cbrt(values.size)
    return min(max(width, span / _MOST), span / _FEWEST)


def _end_at(edges: Array, limit: float, width: float) -> Array:
    """Return the edges with `limit` among them, if it lies between the first and the last."""
    if not edges[0] <= limit <= edges[-1]:
        return edges
    nearest = int(np.argmin(np.abs(edges - limit)))
    if abs(edges[nearest] - limit) < 1e-6 * width:
        edges = edges.copy()
        edges[nearest] = limit
        return edges
    return np.sort(np.append(edges, limit))
