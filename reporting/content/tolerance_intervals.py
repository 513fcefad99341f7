"""Tolerance intervals of one response: what contains 95 %, 99 % and 99.73 % of the production, with a confidence.

A confidence interval says where a mean or an index lies; a tolerance interval says where the parts lie. The normal ones
are the narrower, and hold for normal values only; those from ordered values hold for every distribution, but take more
runs. Where the values do not look normal, or are too few to tell, the normal ones are withheld.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from reporting.arrays import Array
from reporting.capability.intervals import Interval
from reporting.content.normal_factors import one_sided_factor, two_sided_factor
from reporting.content.order_intervals import (
    fewest_runs,
    most_blocks,
    one_sided_order_limit,
    two_sided_order_interval,
)
from reporting.shape.normality import FEWEST_FOR_WORDS, Normality

# The last is the share within three sigma of a normal distribution.
CONTENTS = (0.95, 0.99, 0.9973)
# From here on at most 1 in 20 samples of gamma(16), t5 or uniform values pass for normal; of 50 values up to 9 in 10.
_ENOUGH_TO_TELL = 500
# With a smaller p-value of Anderson's and Darling's test the values are not taken for normal.
_LEAST_P = 0.05
_OF_LOTS = "Withheld: values of a production lot share a shift, and tolerance intervals are for independent values."


@dataclass(frozen=True)
class ContentClaim:
    """Limits that contain a share of the production, in the unit of the response.

    Attributes
    ----------
    content : float
        Share of the production.
    normal : (float, float) or None
        Two-sided interval of normal values.
    normal_lower, normal_upper : float or None
        One-sided limits of normal values: at least the share lies above the one, below the other.
    free : (float, float) or None
        Two-sided interval for any distribution; None with too few values.
    free_lower, free_upper : float or None
        One-sided limits for any distribution.
    runs_one_sided, runs_two_sided : int
        Fewest independent runs from which the limits for any distribution follow.
    """

    content: float
    normal: Interval | None
    normal_lower: float | None
    normal_upper: float | None
    free: Interval | None
    free_lower: float | None
    free_upper: float | None
    runs_one_sided: int
    runs_two_sided: int


@dataclass(frozen=True)
class ToleranceIntervals:
    """Tolerance intervals of a response.

    Attributes
    ----------
    confidence : float
        With which each interval, taken alone, contains its share.
    claims : tuple of ContentClaim
        One for each share, the smallest first.
    note : str
        What the normal ones rest on, or why they are withheld; with production lots, why all are.
    """

    confidence: float
    claims: tuple[ContentClaim, ...]
    note: str


def tolerance_intervals(
    x: Array, shape: Normality, confidence: float, lots: NDArray[np.generic] | None = None
) -> ToleranceIntervals:
    """Return the tolerance intervals of a response.

    Parameters
    ----------
    x : array, shape (n,)
        Finite values.
    shape : Normality
        How far they are from normal.
    confidence : float
        From 0.5 to below 1.
    lots : array, shape (n,), optional
        Production lot of each value; by default all values are independent.
    """
    if lots is not None and np.unique(lots).size < x.size:
        none = np.zeros(0)
        claims = tuple(_claim(none, content, confidence, normal=False) for content in CONTENTS)
        return ToleranceIntervals(confidence, claims, _OF_LOTS)
    refused = _refused(x.size, shape)
    claims = tuple(_claim(np.sort(x), content, confidence, normal=not refused) for content in CONTENTS)
    return ToleranceIntervals(confidence, claims, refused or _caution(x.size))


def _claim(ordered: Array, content: float, confidence: float, *, normal: bool) -> ContentClaim:
    """Return the limits that contain one share."""
    n = ordered.size
    interval, lower, upper = None, None, None
    if normal:
        mean, std = float(np.mean(ordered)), float(np.std(ordered, ddof=1))
        half, beyond = (f(n, content, confidence) * std for f in (two_sided_factor, one_sided_factor))
        interval, lower, upper = (mean - half, mean + half), mean - beyond, mean + beyond
    blocks = most_blocks(n, content, confidence)
    return ContentClaim(
        content=content,
        normal=interval,
        normal_lower=lower,
        normal_upper=upper,
        free=two_sided_order_interval(ordered, blocks),
        free_lower=one_sided_order_limit(ordered, blocks, upper=False),
        free_upper=one_sided_order_limit(ordered, blocks, upper=True),
        runs_one_sided=fewest_runs(content, confidence, 1),
        runs_two_sided=fewest_runs(content, confidence, 2),
    )


def _refused(n: int, shape: Normality) -> str:
    """Return why no normal interval is given; nothing if the values do not speak against a normal distribution."""
    p = shape.anderson_darling_p
    if n < FEWEST_FOR_WORDS or p is None:
        return f"No normal ones: {n} values are too few to tell whether they are normal, {FEWEST_FOR_WORDS} are needed."
    if shape.verdict == "not normal" or p < _LEAST_P:
        return f"No normal ones: the values are not those of a normal distribution (Anderson-Darling p = {p:.2g})."
    return ""


def _caution(n: int) -> str:
    """Return what the normal intervals rest on."""
    text = "The normal ones rest on a normal distribution, against which these values do not speak."
    if n < _ENOUGH_TO_TELL:
        text += (
            f" {n} values cannot show a small skewness or somewhat heavier tails, with which such an interval contains "
            "less than it says."
        )
    return text
