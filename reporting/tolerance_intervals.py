"""Tolerance intervals of one response: limits that contain 95 %, 99 % and 99.73 % of production with a confidence.

A confidence interval says where a mean or an index lies; a tolerance interval says where the parts lie. Normal
intervals are narrower, but valid for normal values only; intervals from ordered values are valid for any distribution,
but need more runs. If the values do not look normal, or are too few to decide, the normal intervals are withheld. Where
they pass as normal, other families mostly pass too and reach farther: the intervals are widened to hold for all.
"""

import math
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import betainc, chdtrc, ndtr, ndtri

from reporting.arrays import Array, gauss_legendre, standard_deviation
from reporting.capability.intervals import Interval, noncentral_t_cdf
from reporting.capability.lots import FEW_LOTS, Lots, describe_lots, design_effect, independent, variance_components
from reporting.capability.shares import MOST
from reporting.shape.fitting import Fits
from reporting.shape.normality import FEWEST_FOR_WORDS, Normality
from reporting.shape.sorted_sample import SortedSample, sorted_sample
from reporting.shape.supported_indices import supported_quantiles

# Standard errors of the mean beyond which its distribution is negligible; number of Gauss-Legendre points up to there.
_REACH, _POINTS = 8.5, 160
_PRECISION = 1e-12
# The last is the share within three sigma of a normal distribution.
CONTENTS = (0.95, 0.99, 0.9973)
# With fewer lots and equal sigma between and within them, normal intervals contain their share in only 80 to 92 %.
_LOTS_FOR_NORMAL = 50
# Values with a smaller p-value, of the test of Anderson and Darling or of the tails, are not treated as normal.
_LEAST_P = 0.05


@dataclass(frozen=True)
class ContentClaim:
    """Limits that contain a share of the production, in the unit of the response."""

    content: float  # share of the production
    normal: Interval | None  # two-sided, for normal values
    normal_lower: float | None  # one-sided: at least the share lies above it
    normal_upper: float | None  # one-sided: at least the share lies below it
    free: Interval | None  # two-sided, for any distribution; None with too few values
    free_lower: float | None  # one-sided
    free_upper: float | None  # one-sided
    runs_one_sided: int  # smallest number of independent runs that suffices for `free_lower` or `free_upper`
    runs_two_sided: int  # and for `free`


@dataclass(frozen=True)
class ToleranceIntervals:
    """Tolerance intervals of a response."""

    confidence: float  # with which each single interval contains its share
    claims: tuple[ContentClaim, ...]  # one for each share, the smallest first
    note: str  # basis of the normal intervals, or why they are withheld; with few production lots, why all are withheld


@dataclass(frozen=True)
class _Worth:
    """Information in the values; `effect` returns how many marked ones count as one independent value, None: one."""

    mean: float
    std: float
    n: float  # independent values that determine the mean as well
    nu: float  # degrees of freedom of std
    effect: Callable[[NDArray[np.bool_]], float] | None


@np.errstate(over="ignore", invalid="ignore")  # squares: such values are never treated as normal, or have no shape
def tolerance_intervals(
    x: Array,
    shape: Normality,
    fits: Fits,
    confidence: float,
    lots: NDArray[np.generic] | None = None,
    ordered: SortedSample | None = None,
) -> ToleranceIntervals:
    """Return the tolerance intervals of finite values, for a confidence of at least 0.5.

    The normal ones also hold for the other candidates of `fits`, and with `lots`, shape (n,), use the mean squares
    between and within lots (Satterthwaite 1946); the others the effective number of values (Korn and Graubard 1998).
    `ordered` are the same values in ascending order, if somebody has sorted them.
    """
    refusal = _refused(x.size, shape)
    if lots is None or independent(lots):
        mean, std = (float(np.mean(x)), standard_deviation(x, ddof=1)) if x.size > 1 else (math.nan, math.nan)
        worth, note = _Worth(mean, std, x.size, x.size - 1, None), refusal or _basis(x.size, fits)
    else:
        described = describe_lots(x, lots)
        if not math.isfinite(described.effective):
            return _withheld("Withheld: the values are too large or too small to be squared.", confidence)
        if round(described.worth) < FEW_LOTS:
            text = f"Withheld: {described.count} production lots, worth {described.worth:.0f}; {FEW_LOTS} are needed."
            return _withheld(text, confidence)
        if round(described.worth) < _LOTS_FOR_NORMAL and not refusal:
            refusal = f"No normal intervals: they need {_LOTS_FOR_NORMAL} production lots."
        worth = _of_lots(x, lots, described, confidence)
        note = (
            f"{refusal or _basis(x.size, fits)} All are computed from the differences between {described.count} "
            f"production lots, whose values are worth {described.effective:.0f} independent ones."
        )
    ordered = sorted_sample(x if ordered is None else ordered)
    claims = tuple(_claim(x, ordered, worth, content, confidence, normal=not refusal) for content in CONTENTS)
    return ToleranceIntervals(confidence, claims if refusal else _widened(ordered, claims, fits, confidence), note)


def _widened(
    ordered: SortedSample, claims: tuple[ContentClaim, ...], fits: Fits, confidence: float
) -> tuple[ContentClaim, ...]:
    """Return the claims with normal limits as far out as those of the other families that the values do not rule out.

    Both ends together may fail as often as one limit alone (Bonferroni).
    """
    tails = np.array([share for claim in claims for share in (1 - claim.content, (1 - claim.content) / 2)])
    shares, confidences = np.concatenate((tails, 1 - tails)).tolist(), (2 * confidence - 1, confidence)
    one, two = supported_quantiles(ordered, fits, shares, confidences)
    lows, highs = (np.array([side[:, end] for side in (one, two)]) for end in (0, 1))
    found = []
    for i, claim in enumerate(claims):
        at, other = 2 * i, tails.size + 2 * i
        assert claim.normal is not None
        assert claim.normal_lower is not None
        assert claim.normal_upper is not None
        both = min(claim.normal[0], lows[1, at + 1]), max(claim.normal[1], highs[1, other + 1])
        lower, upper = min(claim.normal_lower, lows[0, at]), max(claim.normal_upper, highs[0, other])
        found.append(replace(claim, normal=both, normal_lower=lower, normal_upper=upper))
    return tuple(found)


def _of_lots(x: Array, lots: NDArray[np.generic], described: Lots, confidence: float) -> _Worth:
    """Return the information in values of production lots."""
    mean = float(np.mean(x))
    parts = variance_components(x - mean, lots)
    between, within = (parts.between or 0.0) / parts.size, (1 - 1 / parts.size) * (parts.within or 0.0)
    spread = between**2 / (described.worth - 1) + within**2 / (x.size - described.count)
    return _Worth(
        mean=mean,
        std=math.sqrt(between + within),
        n=described.effective,
        nu=(between + within) ** 2 / spread if spread > 0 else x.size - 1,
        effect=lambda beyond: design_effect(beyond, lots, described, confidence),
    )


def _claim(
    x: Array, ordered: SortedSample, worth: _Worth, content: float, confidence: float, *, normal: bool
) -> ContentClaim:
    """Return the intervals for one content of values, which are given in their own order and in ascending order."""
    found = _without(content, confidence)
    if normal:
        half, beyond = (
            factor(worth.n, content, confidence, worth.nu) * worth.std
            for factor in (two_sided_factor, one_sided_factor)
        )
        low, high = worth.mean - half, worth.mean + half
        found = replace(found, normal=(low, high), normal_lower=worth.mean - beyond, normal_upper=worth.mean + beyond)
    if x.size == 0:
        return found
    lower = upper = both = most_blocks(x.size, content, confidence)
    if worth.effect is not None:
        low, high, outer_low, outer_high = ordered.quantiles(
            (1 - content, content, (1 - content) / 2, (1 + content) / 2)
        )
        # Values of a lot lie beyond a limit together: the design effect is that of the share beyond the quantile that
        # the limit estimates.
        marked = (x < low, x > high, (x < outer_low) | (x > outer_high))
        lower, upper, both = (most_blocks(x.size, content, confidence, worth.effect(out)) for out in marked)
    return replace(
        found,
        free=two_sided_order_interval(ordered.values, both),
        free_lower=one_sided_order_limit(ordered.values, lower, upper=False),
        free_upper=one_sided_order_limit(ordered.values, upper, upper=True),
    )


def _withheld(why: str, confidence: float) -> ToleranceIntervals:
    """Return a result without intervals, and why they are withheld."""
    return ToleranceIntervals(confidence, tuple(_without(content, confidence) for content in CONTENTS), why)


def _without(content: float, confidence: float) -> ContentClaim:
    """Return a claim without limits, and the number of runs that they would require."""
    runs = [fewest_runs(content, confidence, blocks) for blocks in (1, 2)]
    return ContentClaim(content, None, None, None, None, None, None, *runs)


def _refused(n: int, shape: Normality) -> str:
    """Return why no normal interval is given; empty if the values are compatible with a normal distribution."""
    p = shape.anderson_darling_p
    if n < FEWEST_FOR_WORDS or p is None:
        return f"No normal intervals: {n} values are too few to test for normality; {FEWEST_FOR_WORDS} are needed."
    of_all = p if shape.p is None else shape.p  # of the test of the middle and those of the tails together
    if shape.verdict == "not normal" or min(p, of_all) < _LEAST_P:
        are = "are not" if shape.verdict == "not normal" else "may not be"
        test = f"Anderson-Darling p = {p:.2g}" if p <= of_all else f"middle and tails together: p = {of_all:.2g}"
        return f"No normal intervals: the values {are} normal ({test})."
    return ""


def _basis(n: int, fits: Fits) -> str:
    """Return what the normal intervals assume."""
    others = sum(family != "normal" for family in fits.candidates)
    text = "The normal intervals assume a normal distribution, which these values do not contradict"
    if others:
        text += f"; they are widened to hold for {others} others that the values allow as well"
    # 1 - 0.05^(1/n): absent from n values in 5 % of cases
    unseen = 100 * (1 - 0.05 ** (1 / n))
    return f"{text}. They do not allow for a second population in fewer than {unseen:.2g} % of the parts."


# -- from ordered values, for any distribution (Wilks 1941) ------------------------------------------------------------
#
# The content of the interval between the r-th and the s-th smallest of n independent values has a beta distribution,
# whatever the distribution of the values (if it has atoms, the content is larger). It depends on the number of blocks
# left out, ``v = n + 1 - (s - r)``: one for a one-sided interval that ends at the largest value, two for the interval
# from the smallest to the largest. The confidence of a content P is then ``I(1 - P; v, n + 1 - v)``.


def confidence_of_blocks(blocks: int, n: int, content: float, effect: float = 1.0) -> float:
    """Return the confidence that an interval without `blocks` of ``n + 1`` blocks contains the share `content`."""
    beyond = blocks - 1  # values beyond the interval or at its other end
    return float(betainc(beyond / effect + 1, (n - beyond) / effect, 1 - content))


def most_blocks(n: int, content: float, confidence: float, effect: float = 1.0) -> int:
    """Return the largest number of blocks that may be left out; 0 if not even one may be."""
    enough = range(1, n + 1)
    return bisect_left(enough, True, key=lambda v: confidence_of_blocks(v, n, content, effect) < confidence)


def fewest_runs(content: float, confidence: float, blocks: int) -> int:
    """Return the fewest independent runs for an interval that leaves out 1 (one-sided), 2, or more blocks."""
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


# Exact factors k of normal tolerance intervals: ``mean -+ k s`` contains a share of the production.
#
# One-sided: ``sqrt(n) k`` is a quantile of the noncentral t distribution with noncentrality ``sqrt(n) z_P`` (Hahn and
# Meeker 1991). Two-sided: the content of ``mean -+ k s`` is at least P if s is at least ``r(x) / k``, with x the error
# of the mean in sigmas and ``Phi(x + r) - Phi(x - r) = P``; the probability of that is one integral over x (Odeh and
# Owen 1980; Eberhardt, Mee, Reeve 1989; ISO 16269-6, annex F). No approximation is used.


@lru_cache(maxsize=256)
def one_sided_factor(n: float, content: float, confidence: float, nu: float | None = None) -> float:
    """Return k so that the share `content` (from 0.5) lies below ``mean + k s``; n and `nu` as `two_sided_factor`."""
    freedom, shift = n - 1 if nu is None else nu, math.sqrt(n) * float(ndtri(content))
    return _root(lambda t: noncentral_t_cdf(t, freedom, shift) - confidence, shift + 1.0) / math.sqrt(n)


@lru_cache(maxsize=256)
def two_sided_factor(n: float, content: float, confidence: float, nu: float | None = None) -> float:
    """Return k so that the share `content` lies within ``mean -+ k s``; n values for the mean, s with `nu` degrees."""
    freedom = n - 1 if nu is None else nu
    points, weights = gauss_legendre(_POINTS)
    z = _REACH * (points + 1) / 2
    density = _REACH * weights * np.exp(-z * z / 2) / math.sqrt(2 * math.pi)  # for both signs of the error
    square = freedom * _half_widths(z / math.sqrt(n), content) ** 2
    return _root(lambda k: float(density @ chdtrc(freedom, square / k**2)) - confidence, 2.0)


def _half_widths(x: Array, content: float) -> Array:
    """Return r with ``Phi(x + r) - Phi(x - r) = content``, by bisection on the tails, which keep their digits."""
    low: Array = np.full(x.size, float(ndtri((1 + content) / 2)))
    high: Array = x + low
    for _ in range(60):
        middle = (low + high) / 2
        short = ndtr(x - middle) + ndtr(-x - middle) > 1 - content
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    return np.asarray((low + high) / 2)


def _root(rising: Callable[[float], float], start: float) -> float:
    """Return the zero of an increasing function of a positive number."""
    from scipy.optimize import brentq  # takes 0.4 s, which `import reporting` avoids

    low = high = start
    while rising(low) > 0:
        low /= 2
    while rising(high) < 0:
        high *= 2
    return float(brentq(rising, low, high, xtol=_PRECISION, rtol=_PRECISION)) if low < high else start
