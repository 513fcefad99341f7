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
    """Return the confidence that an interval contains the share `content`.

    Parameters
    ----------
    blocks : int
        Number of blocks left out, from 1 to n.
    n : int
        Number of values.
    content : float
        Share of production, between 0 and 1.
    effect : float
        Design effect: number of values that determine a share as well as one independent value, at least 1 (Korn and
        Graubard 1998).
    """
    beyond = blocks - 1  # values beyond the interval or at its other end
    return float(betainc(beyond / effect + 1, (n - beyond) / effect, 1 - content))


def most_blocks(n: int, content: float, confidence: float, effect: float = 1.0) -> int:
    """Return the largest number of blocks that may be left out; 0 if not even one may be.

    Parameters
    ----------
    n : int
        Number of values.
    content, confidence : float
        Values between 0 and 1.
    effect : float
        See `confidence_of_blocks`.
    """
    enough = range(1, n + 1)
    return bisect_left(enough, True, key=lambda v: confidence_of_blocks(v, n, content, effect) < confidence)


def fewest_runs(content: float, confidence: float, blocks: int) -> int:
    """Return the smallest number of independent runs for an interval that leaves out `blocks` blocks.

    Parameters
    ----------
    content, confidence : float
        Values between 0 and 1.
    blocks : int
        Number of blocks left out: 1 for a one-sided interval, 2 for a two-sided one, plus 1 for each value beyond it.
    """
    runs = range(blocks, MOST)
    return runs[bisect_left(runs, True, key=lambda n: confidence_of_blocks(blocks, n, content) >= confidence)]


def two_sided_order_interval(ordered: Array, blocks: int) -> Interval | None:
    """Return the interval that leaves out at most `blocks` blocks, equally on both sides; None for fewer than two.

    Parameters
    ----------
    ordered : array, shape (n,)
        Values in ascending order.
    blocks : int
        Largest number of blocks that may be left out.
    """
    if blocks < 2:
        return None
    return float(ordered[blocks // 2 - 1]), float(ordered[-((blocks + 1) // 2)])


def one_sided_order_limit(ordered: Array, blocks: int, *, upper: bool) -> float | None:
    """Return the upper or lower limit that leaves out `blocks` blocks beyond it; None for fewer than one.

    Parameters
    ----------
    ordered : array, shape (n,)
        Values in ascending order.
    blocks : int
        Largest number of blocks that may be left out.
    upper : bool
    """
    if blocks < 1:
        return None
    return float(np.flip(ordered)[blocks - 1] if upper else ordered[blocks - 1])
