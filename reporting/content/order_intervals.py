"""Tolerance intervals from ordered values, for any distribution (Wilks 1941), and the number of runs they require.

The content of the interval between the r-th and the s-th smallest of n independent values has a beta distribution,
whatever the distribution of the values (if it has atoms, the content is larger). It depends on the number of blocks
left out, ``v = n + 1 - (s - r)``: one for a one-sided interval that ends at the largest value, two for the interval
from the smallest to the largest. The confidence of a content P is then ``I(1 - P; v, n + 1 - v)``.
"""

from bisect import bisect_left

import numpy as np
from scipy.special import betainc

from reporting.arrays import Array
from reporting.capability.intervals import Interval
from reporting.capability.shares import MOST


def confidence_of_blocks(blocks: int, n: int, content: float, effect: float = 1.0) -> float:
    """Return the confidence that an interval without `blocks` of ``n + 1`` blocks contains the share `content`.

    `effect` is the number of values that determine a share as well as one independent value (Korn and Graubard 1998).
    """
    beyond = blocks - 1  # values beyond the interval or at its other end
    return float(betainc(beyond / effect + 1, (n - beyond) / effect, 1 - content))


def most_blocks(n: int, content: float, confidence: float, effect: float = 1.0) -> int:
    """Return the largest number of blocks that may be left out; 0 if not even one may be."""
    enough = range(1, n + 1)
    return bisect_left(enough, True, key=lambda v: confidence_of_blocks(v, n, content, effect) < confidence)


def fewest_runs(content: float, confidence: float, blocks: int) -> int:
    """Return the smallest number of independent runs for an interval that leaves out `blocks` blocks.

    A one-sided interval leaves out 1, a two-sided one 2, plus 1 for each value beyond it.
    """
    runs = range(blocks, MOST)
    return runs[bisect_left(runs, True, key=lambda n: confidence_of_blocks(blocks, n, content) >= confidence)]


def two_sided_order_interval(ordered: Array, blocks: int) -> Interval | None:
    """Return the interval of ascending values without at most `blocks`, equally on both sides; None below two."""
    if blocks < 2:
        return None
    return float(ordered[blocks // 2 - 1]), float(ordered[-((blocks + 1) // 2)])


def one_sided_order_limit(ordered: Array, blocks: int, *, upper: bool) -> float | None:
    """Return the limit of ascending values that leaves out `blocks` blocks beyond it; None for fewer than one."""
    if blocks < 1:
        return None
    return float(np.flip(ordered)[blocks - 1] if upper else ordered[blocks - 1])
