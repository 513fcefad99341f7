"""Check of the weights against plain Monte Carlo, at a share that both can estimate.

Some runs of the campaign are drawn from the distributions themselves (plain runs). The limit is moved inward until a
few percent of the plain runs lie beyond it; their counted share must agree with the weighted share of all runs. The
difference is the mean of I (w - c / a0) over the runs: I is 1 if a run lies beyond, w its weight, c is 1 for a plain
run, a0 is the share of plain runs. Its expectation is 0 for every limit, and its standard error is known.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from reporting.arrays import Array

SEEN = 0.02  # share of plain runs beyond the moved limit; at least FEWEST_SEEN runs
FEWEST_SEEN = 20
CHECK_BAR = 4.0  # standard errors that are not exceeded by chance


@dataclass(frozen=True)
class PlainCheck:
    """A share estimated from plain and from weighted runs."""

    response: str
    side: str  # "below" or "above"
    at: float  # the moved limit, in the response's unit
    plain: float  # share beyond it, counted among the plain runs
    weighted: float  # the same, weighted over all runs
    errors: float  # their difference in standard errors


def plain_check(
    response: str, side: str, y: Array, weights: Array, is_plain: NDArray[np.bool_], plain_share: float
) -> PlainCheck | None:
    """Compare a weighted with a counted share of one response; None with too few plain runs.

    `y`, shape (n,), is NaN where a run has none; `plain_share` is the planned share of plain runs.
    """
    seen = np.sort(y[is_plain & np.isfinite(y)] * (1.0 if side == "below" else -1.0))
    beyond = max(FEWEST_SEEN, round(SEEN * seen.size))
    if seen.size < 2 * beyond:
        return None
    at = 0.5 * (seen[beyond - 1] + seen[beyond]) * (1.0 if side == "below" else -1.0)
    rejects = (y < at if side == "below" else y > at).astype(np.float64)
    counted = rejects * is_plain / plain_share
    difference = rejects * weights - counted
    error = float(np.std(difference, ddof=1)) / np.sqrt(y.size)
    errors = float(difference.mean() / error) if error > 0.0 else 0.0
    return PlainCheck(response, side, float(at), float(counted.mean()), float((rejects * weights).mean()), errors)
