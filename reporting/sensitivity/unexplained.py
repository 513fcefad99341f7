"""The share of a response's variance that is not explained by single variables: scatter, and the rest.

No sum of functions of single variables explains it. Repeats with half the step measure how much of it is scatter, which
no input causes; only the rest can be interactions or jumps. `docs/sensitivity.md` has the derivation and its test.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from reporting.capability.intervals import Interval
from reporting.sensitivity.measures import CRITICAL_SHARE
from reporting.sensitivity.repeatability import Repeatability
from reporting.sensitivity.total_order import TotalOrder


@dataclass(frozen=True)
class Known:
    """Information about a response beyond one run of each sample."""

    totals: TotalOrder | str | None = None  # total-order indices of a design, or why there are none
    repeatability: Repeatability | None = None  # from repeats with half the step

    @property
    def scatter(self) -> tuple[float, Interval] | None:
        """Share of the variance that is scatter, and its interval; None if it is not measured."""
        found = self.repeatability
        if found is None or found.share is None or found.share_interval is None:
            return None
        return found.share, found.share_interval


@dataclass(frozen=True)
class Unexplained:
    """A share of the variance that no sum of functions of single variables explains."""

    share: float  # the whole; the estimate may lie outside 0 to 1 by chance
    interval: Interval
    scatter: float | None = None  # the part that no input causes; None if it is not measured
    scatter_interval: Interval | None = None
    rest: float | None = None  # the share without scatter: interactions and jumps; None if scatter is not measured
    rest_interval: Interval | None = None

    @property
    def most_interactions(self) -> float:
        """The largest possible share of interactions."""
        return self.interval[1] if self.rest_interval is None else self.rest_interval[1]


def split(share: float, half: float, known: Known) -> Unexplained:
    """Return an unexplained share, whose interval has the half width `half`, split into its parts.

    The squared distance to each end of the rest's interval is the sum of the squared distances of both shares (method
    of variance estimates recovery: their errors are independent, because repeats are separate runs).
    """
    interval = _within(share - half), _within(share + half)
    if known.scatter is None:
        return Unexplained(share, interval)
    scatter, (low, high) = known.scatter
    rest = share - scatter
    ends = _within(rest - math.hypot(half, high - scatter)), _within(rest + math.hypot(half, scatter - low))
    return Unexplained(share, interval, scatter, (low, high), _within(rest), ends)


def without_scatter(totals: TotalOrder, known: Known, quantile: float) -> TotalOrder:
    """Return total-order indices without the scatter that each of them contains.

    A total-order index is half the mean squared difference of two runs that differ in one variable, divided by the
    variance. Each run scatters independently, so scatter adds its whole share of the variance to the total-order index
    of every variable and to its interactions, but nothing to the first-order index. If the two runs are equal, the
    variable has no effect and no scatter is subtracted.
    """
    if known.scatter is None:
        return totals
    share, (low, high) = known.scatter
    error = (high - low) / (2 * quantile)
    off = np.minimum(share, np.maximum(totals.total, 0.0))
    return replace(
        totals,
        total=totals.total - off,
        total_error=np.hypot(totals.total_error, np.where(off > 0, error, 0.0)),
        interactions=totals.interactions - off,
        interactions_error=np.hypot(totals.interactions_error, np.where(off > 0, error, 0.0)),
    )


def note_on(found: Unexplained, known: Known, *, independent: bool) -> str:
    """Return what an unexplained share of at least a tenth means, and how to learn more; empty for smaller shares."""
    if found.share < CRITICAL_SHARE:
        return ""
    text = f"{_percent(found.share)} of the variance does not come from variables acting alone"
    if found.rest is None or found.scatter is None or found.scatter_interval is None:
        return f"{text}: interactions, jumps, or scatter that no repeat has measured. {_advice(known, independent)}"
    low, high = map(_percent, found.scatter_interval)
    text += f"; {_percent(found.scatter)} ({low} to {high}) is scatter that no input causes (repeatability)"
    if found.rest < CRITICAL_SHARE:
        return f"{text}, which explains it: no further samples will find a variable that causes it."
    if found.rest_interval is not None and found.rest_interval[0] <= 0.0:
        return f"{text}, which may explain all of it: samples and repeats do not show whether variables interact."
    return f"{text}. The rest, {_percent(found.rest)}, is interactions or jumps. {_advice(known, independent)}"


def _advice(known: Known, independent: bool) -> str:
    """Return how to find out which variables interact."""
    if isinstance(known.totals, TotalOrder):
        return "The shares with interactions show which variables cause it."
    if not independent:
        return "Which variables cause it cannot be found out: total-order indices need independent variables."
    first = "First repeat some samples (clearcap repeat). " if known.scatter is None else ""
    return (
        f"{first}A variable with no effect of its own may still matter in combination with others: a campaign with the"
        " sampler saltelli shows it (total-order indices)."
    )


def _percent(share: float) -> str:
    """Return a share as percent without decimals."""
    return f"{100 * _within(share):.0f} %"


def _within(value: float) -> float:
    """Return an estimate of a share, clipped to 0 and 1."""
    return min(max(value, 0.0), 1.0)
