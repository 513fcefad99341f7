"""Scatter of a response that its inputs do not cause: two runs of the same sample with different steps.

A run with half the step has the same inputs, but a different history of sticking, sliding and impacts. Half the
variance of the difference of two such runs is the variance due to the history alone, the *scatter* of the response; the
mean difference is not scatter, but the effect of the step size on all runs.

The interval of the scatter is that of a variance whose error is estimated from the fourth moment of the differences
(`reporting.capability.interval_choice`); it is never narrower than for normal differences. The interval of its share
of the response's variance adds the squared distances of both intervals on a logarithmic scale. Measured coverage of
95 % intervals of the share is in ``studies/coverage.md``. With few pairs, scatter that only some samples show may be
missed altogether: `unseen` is the largest share of such samples that may have no pair.

The scatter of the rows is part of what their inputs leave unexplained, so it is capped by the variance that a
cross-validated model of the rows leaves. If the pairs differ by more than that, it is the runs with half the step that
differ, and the result depends on the step: a bias, or a few samples that behave in another way.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri, stdtrit

from reporting.arrays import ROUNDING, Array
from reporting.capability.interval_choice import own_moments
from reporting.capability.intervals import Interval
from reporting.capability.moments import location_and_shape
from reporting.capability.summary import capability
from reporting.samples import Repeats, Samples
from reporting.spec import ReportSpec

FEWEST_PAIRS = 5  # for an interval
NOTABLE_SHARE = 0.10  # of the variance: the threshold of a critical variable


@dataclass(frozen=True)
class Repeatability:
    """Repeatability of a response, from repeated samples."""

    pairs: int  # samples with a value from both runs
    lost: int  # repeated samples for which only one of the two runs succeeded
    sigma: float | None = None  # of the scatter, in the response's unit; None below two pairs
    sigma_interval: Interval | None = None  # None below five pairs
    # Of the response's variance that is scatter; None if the samples do not represent production, or the response does
    # not vary.
    share: float | None = None
    share_interval: Interval | None = None
    shift: float | None = None  # mean of the runs with half the step minus that of the others, in the response's unit
    shift_interval: Interval | None = None
    unseen: float | None = None  # upper confidence bound of the share of samples that scatter although no pair does
    # Half the variance of the differences, as a share of that of the response, where it is more than the rows leave
    # unexplained: the result depends on the step. Else None.
    beyond_rows: float | None = None

    @property
    def removable(self) -> float | None:
        """Largest share of the variance that the inputs can explain: 1 minus the share of scatter."""
        return None if self.share is None else 1 - self.share


def repeatability(
    first: Array,
    second: Array,
    std: float | None,
    std_interval: Interval | None,
    confidence: float,
    left: Interval | None = None,
) -> Repeatability:
    """Return the scatter between the two runs of some samples."""
    # `first`, shape (m,), are the runs of the campaign, `second` those with half the step, NaN where a run has no
    # value. `std` is that of the response over all samples; None if no share is wanted. `left` is the share of its
    # variance that the inputs leave unexplained, with an upper bound; None if it is not known.
    both = np.isfinite(first) & np.isfinite(second)
    pairs, lost = int(both.sum()), int(np.sum(np.isfinite(first) ^ np.isfinite(second)))
    if pairs < 2:
        return Repeatability(pairs, lost)
    difference = second[both] - first[both]
    shape = location_and_shape(difference)
    shift, spread = shape["mean"], shape["std"]
    level = max(float(np.abs(first[both]).max()), float(np.abs(second[both]).max()))
    if spread <= ROUNDING * level:  # the two runs differ by rounding only
        spread = 0.0
    ratios = _ratios(difference, shape, spread, confidence)
    sigma = spread / math.sqrt(2)
    half = float(stdtrit(pairs - 1, 0.5 + confidence / 2)) * spread / math.sqrt(pairs)
    share = share_interval = beyond = None
    if std:
        share = min((sigma / std) ** 2, 1.0)
        share_interval = None if ratios is None else _share_interval((sigma / std) ** 2, ratios, std, std_interval)
        if left is not None and share > left[1]:
            beyond, share = (sigma / std) ** 2, left[0]
            sigma = std * math.sqrt(share)
            share_interval = None if ratios is None else (0.0, left[1])
    return Repeatability(
        pairs=pairs,
        lost=lost,
        sigma=sigma,
        sigma_interval=None if ratios is None else (sigma * math.sqrt(ratios[0]), sigma * math.sqrt(ratios[1])),
        share=share,
        share_interval=share_interval,
        shift=shift,
        shift_interval=(shift - half, shift + half),
        unseen=1 - (1 - confidence) ** (1 / pairs),
        beyond_rows=beyond,
    )


def unexplained_by_rows(x: Array, y: Array) -> Interval | None:
    """Return the share of the variance of y, (n,), that its inputs x, (n, d), leave unexplained, and an upper bound."""
    # From the squared errors at rows left out one by one, of a linear model or of one with squares, whichever errs
    # less. None with too few rows.
    if y.size < 3:  # fewer than the mean alone takes; none where every run failed
        return None
    x = x[:, np.ptp(x, axis=0) > 0]  # the deviation of equal values may differ from 0 by rounding
    z = (x - x.mean(axis=0)) / x.std(axis=0)
    spread, found = float(np.var(y, ddof=1)), list[Interval]()
    for columns in (z, np.hstack([z, z * z])):
        features = np.column_stack([np.ones(y.size), columns])
        if y.size < 3 * features.shape[1] or not spread > 0:
            continue
        basis = np.linalg.qr(features)[0]
        leverage = np.minimum(np.sum(basis * basis, axis=1), 1 - 1e-9)
        squared = ((y - basis @ (basis.T @ y)) / (1 - leverage)) ** 2 / spread
        mean, error = float(np.mean(squared)), float(np.std(squared)) / math.sqrt(y.size)
        found.append((min(mean, 1.0), min(mean + 2 * error, 1.0)))
    return min(found, default=None)


def _ratios(difference: Array, shape: dict[str, float], spread: float, confidence: float) -> Interval | None:
    """Return the ends of the interval of the variance of the differences, as shares of it."""
    freedom, tail = difference.size - 1, 0.5 - confidence / 2
    if difference.size < FEWEST_PAIRS:
        return None
    low, high = freedom / float(chdtri(freedom, tail)), freedom / float(chdtri(freedom, 1 - tail))
    if spread == 0.0 or "kurtosis" not in shape:
        return low, high
    own = own_moments(difference).precision(shape["kurtosis"], confidence).std_interval
    return min(low, (own[0] / spread) ** 2), max(high, (own[1] / spread) ** 2)


def _share_interval(share: float, ratios: Interval, std: float, std_interval: Interval | None) -> Interval:
    """Return the interval of a share of a variance that is itself uncertain."""
    low, high = std_interval or (std, std)
    below = math.hypot(math.log(ratios[0]), 2 * math.log(high / std))
    above = math.hypot(math.log(ratios[1]), 2 * math.log(std / low)) if low > 0 else math.inf
    # exp(710) overflows.
    return min(share * math.exp(-below), 1.0), min(share * math.exp(min(above, 700.0)), 1.0)


def repeatabilities(
    repeats: Repeats | None, samples: Samples, drawn: Samples, spec: ReportSpec, confidence: float
) -> dict[str, Repeatability]:
    """Return the repeatability of each response; empty without repeats."""
    # `drawn` are the independent draws, whose variance represents production. Samples that importance sampling aims at
    # rejects are left out.
    if repeats is None or not repeats.sample.size:
        return {}
    pool = drawn if spec.proposal else samples
    place = np.searchsorted(pool.sample, repeats.sample)
    at = np.minimum(place, max(pool.sample.size - 1, 0))
    there = pool.sample[at] == repeats.sample if pool.sample.size else np.zeros(place.size, np.bool_)
    found = {}
    for response in spec.responses:
        y = drawn.values[response.name][drawn.ok]
        lots = None if drawn.lots is None else drawn.lots[drawn.ok]
        numbers = capability(y, confidence=confidence, lots=lots, ordered=False)
        known = (numbers.std, numbers.std_interval) if spec.design.production else (None, None)
        inputs = np.column_stack([drawn.values[v.name][drawn.ok] for v in spec.variables]) if spec.variables else None
        known_y = np.isfinite(y) if inputs is None else np.isfinite(y) & np.isfinite(inputs).all(axis=1)
        left = None if inputs is None else unexplained_by_rows(inputs[known_y], y[known_y])
        first = np.where(pool.ok, pool.values[response.name], np.nan)[at[there]]
        second = np.where(repeats.ok, repeats.values[response.name], np.nan)[there]
        found[response.name] = repeatability(first, second, *known, confidence, left)
    return found
