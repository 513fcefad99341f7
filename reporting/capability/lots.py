"""Production lots: values of one lot share a shift, so n values carry less information than n independent values.

The number of lots, not the number of values in each, determines how well differences between lots are known. Errors are
therefore computed from sums over whole lots (cluster-robust, Liang and Zeger 1986), with the lots' degrees of freedom.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri, stdtrit

from reporting.arrays import Array, sums

# Measured coverage of 95 % intervals with normal shifts, sigma between lots 0 to 1 times the sigma within: 95 to 98 %
# for five lots or more. For strongly skewed shifts it is about 90 % below twenty lots; if one lot in twenty is bad by
# three sigmas, 42 to 63 %, because a sample of twenty lots often has none of them.
LEAST_LOTS, FEW_LOTS = 5, 20
# So many lots contain, in 95 % of cases, one of a kind to which one lot in twenty belongs.
ALL_KINDS = 59
_HERMITE_POINTS = 60


@dataclass(frozen=True)
class Lots:
    """The production lots of the values of one response."""

    count: int  # lots with a value
    worth: float  # lots of equal size that determine a mean equally well, at most `count` (Kish: ``n^2 / sum n_i^2``)
    effective: float  # independent values that determine the mean equally well, at most the number of values
    intraclass: float  # share of the variance that lies between lots (intraclass correlation), from 0 to 1
    least: int = LEAST_LOTS  # smallest number of lots of equal size for which intervals are given

    @property
    def blind(self) -> str:
        """What so few lots do not show, in one sentence; empty with `ALL_KINDS`, whatever the lots look like."""
        if round(self.worth) >= ALL_KINDS:
            return ""
        unseen = 100 * (1 - 0.05 ** (1 / self.worth))
        return (
            f"Of {self.count} lots, a kind to which fewer than {unseen:.0f} % of the lots belong may be missing: if "
            "rare lots are bad, the intervals are too narrow."
        )

    @property
    def enough(self) -> bool:
        """Whether there are enough lots for an interval; failed runs may make lots slightly unequal."""
        return round(self.worth) >= self.least


@dataclass(frozen=True)
class VarianceComponents:
    """One-way analysis of variance of values in lots."""

    counts: NDArray[np.int64]  # values of each lot, shape (lots,)
    within: float | None  # mean square; None where each lot has one value
    between: float | None  # mean square; None with one lot
    size: float  # values of a lot in the expected mean square between lots; the mean size where all are equal

    @property
    def variance_between(self) -> float | None:
        """Variance of the lots' shifts, at least 0; None where a mean square is missing."""
        if self.within is None or self.between is None:
            return None
        return max(0.0, (self.between - self.within) / self.size)


def variance_components(x: Array, lots: NDArray[np.generic]) -> VarianceComponents:
    """Return the analysis of variance of values whose mean is zero, by lot."""
    _, group = np.unique(lots, return_inverse=True)
    counts = np.bincount(group)
    means = np.bincount(group, weights=x) / counts
    nu, k = x.size - counts.size, counts.size
    within = float(np.sum((x - means[group]) ** 2)) / nu if nu else None
    if k == 1:
        return VarianceComponents(counts, within, None, float(x.size))
    between = float(np.sum(counts * means**2)) / (k - 1)
    size = (x.size - float(np.sum(counts.astype(np.float64) ** 2)) / x.size) / (k - 1)
    return VarianceComponents(counts, within, between, size)


def independent(lots: NDArray[np.generic] | None) -> bool:
    """Return whether no two values share a lot."""
    return lots is None or np.unique(lots).size == lots.size


def describe_lots(x: Array, lots: NDArray[np.generic]) -> Lots:
    """Return the number of lots and the effective numbers of lots and values, of at least one finite value."""
    parts = variance_components(x - np.mean(x), lots)
    worth = lots_worth(parts.counts)
    shifts = parts.variance_between
    total = 0.0 if shifts is None else shifts + (parts.within or 0.0)
    share = 0.0 if shifts is None or total == 0 else shifts / total
    return Lots(int(parts.counts.size), worth, 1 / (share / worth + (1 - share) / x.size), share)


def lots_worth(weights: Array | NDArray[np.int64]) -> float:
    """Return the number of equally weighted lots that determine a mean as well as lots with these weights (Kish)."""
    # sums of whole numbers are exact, so that 20 equal lots are worth 20
    share = np.asarray(weights, np.float64)
    return float(np.sum(share) ** 2 / np.sum(share**2))


def lot_error(influence: Array, weight: Array, lots: NDArray[np.generic] | None) -> tuple[float, float]:
    """Return the standard error of a weighted mean of influences, ``sum_i w_i IF_i``, and its degrees of freedom.

    Values of one lot are correlated, so their terms are summed before they are squared; the error is infinite with one
    lot, the degrees of freedom are infinite for independent values.
    """
    terms = weight * influence
    if lots is None or independent(lots):
        terms *= terms
        return math.sqrt(float(np.sum(terms))), math.inf
    _, group = np.unique(lots, return_inverse=True)
    sums = np.bincount(group, weights=terms)
    if sums.size == 1:
        return math.inf, 0.0
    error = math.sqrt(sums.size / (sums.size - 1) * float(np.sum(sums**2)))
    return error, lots_worth(np.bincount(group, weights=weight)) - 1


def mean_error(x: Array, influence: Callable[[Array], Array], lots: NDArray[np.generic] | None) -> tuple[float, float]:
    """Return what `lot_error` does, of influences with equal weights, which are a function of the values."""
    if lots is None or independent(lots):
        return math.sqrt(sums(x, lambda piece: (np.square(influence(piece)),))[0]) / x.size, math.inf
    return lot_error(influence(x), np.broadcast_to(1 / x.size, x.shape), lots)


def design_effect(is_out: NDArray[np.bool_], lots: NDArray[np.generic], described: Lots, confidence: float) -> float:
    """Return the design effect of lots: how many values determine a share as well as one independent value, at least 1.

    The larger of two estimates: the spread of counts per lot tells little if few values are out, and the normal model,
    in which correlated values exceed a limit, does not represent other shapes. Few lots increase it, as Student's t
    widens the interval of a mean (Korn and Graubard 1998).
    """
    n, count = is_out.size, int(np.count_nonzero(is_out))
    if not described.enough or n < 2:  # a lot is treated as one value
        return n / described.worth
    # Without a reject, or with rejects only, the normal model has no threshold: one value more or less gives one.
    share = min(max(count, 1), n - 1) / n
    inflation = 1 + (n / described.worth - 1) * _threshold_correlation(share, described.intraclass)
    if 0 < count < n:
        error, _ = lot_error(np.asarray(is_out - count / n, np.float64), np.full(n, 1 / n), lots)
        inflation = max(inflation, error**2 * n / (share * (1 - share)))
    p = 0.5 + confidence / 2
    few = float(stdtrit(described.worth - 1, p) / ndtri(p)) ** 2
    return min(1 + max(inflation - 1, 0.0) * few, float(n))


def _threshold_correlation(share: float, correlation: float) -> float:
    """Return the correlation of two events of probability `share`: correlated normal values that exceed a limit."""
    if correlation <= 0:
        return 0.0
    points, weights = _hermite()
    rest = math.sqrt(max(1 - correlation, 1e-12))
    of_lot = ndtr((ndtri(share) + math.sqrt(correlation) * points) / rest)
    return float((weights @ of_lot**2 - (weights @ of_lot) ** 2) / (share * (1 - share)))


@lru_cache(maxsize=1)
def _hermite() -> tuple[Array, Array]:
    """Return Gauss-Hermite points and weights that sum to 1, for expectations over the standard normal distribution."""
    points, weights = np.polynomial.hermite_e.hermegauss(_HERMITE_POINTS)
    return points, weights / weights.sum()
