"""The values at hand beside the mean and sigma that the process is known to have.

A process that has run for years has a mean and a sigma that one sample does not overrule. The indices with both say
what is promised on that ground; the intervals of the differences say whether these values still agree with it.
"""

from dataclasses import dataclass

from reporting.capability.indices import point_indices
from reporting.capability.intervals import Interval
from reporting.capability.summary import Capability


@dataclass(frozen=True)
class Historical:
    """Indices with the historical mean and sigma, and how far the values are from both."""

    mean: float  # as given, in the unit of the response
    sigma: float
    cp: float | None  # None where a limit is missing
    cpk: float | None
    shift: float | None  # mean of the values less the historical mean, in the unit of the response
    shift_interval: Interval | None  # None where the mean has no interval
    ratio: float | None  # standard deviation of the values by the historical sigma
    ratio_interval: Interval | None
    finding: str  # what contradicts the historical values at the stated confidence; empty if nothing does


def historical(numbers: Capability, mean: float | None, sigma: float | None) -> Historical | None:
    """Return the capability with the historical mean and sigma (above 0), and the differences; None without them."""
    if mean is None or sigma is None:
        return None
    index = point_indices(mean, sigma, numbers.lsl, numbers.usl)
    shift = None if numbers.mean is None else numbers.mean - mean
    ratio = None if numbers.std is None else numbers.std / sigma
    of_mean, of_std = numbers.mean_interval, numbers.std_interval
    between = None if of_mean is None else (of_mean[0] - mean, of_mean[1] - mean)
    times = None if of_std is None else (of_std[0] / sigma, of_std[1] / sigma)
    contradicted = [
        words
        for interval, agreed, words in ((between, 0.0, "mean"), (times, 1.0, "sigma"))
        if interval is not None and not interval[0] <= agreed <= interval[1]
    ]
    return Historical(
        mean, sigma, index["cp"], index["cpk"], shift, between, ratio, times, _finding(contradicted, numbers.confidence)
    )


def _finding(contradicted: list[str], confidence: float) -> str:
    if not contradicted:
        return ""
    parts = " and ".join(f"the historical {words}" for words in contradicted)
    return (
        f"These values contradict {parts} at {100 * confidence:g} % confidence: the process has changed, or they are"
        " not of this process. The indices with the historical values do not describe them."
    )
