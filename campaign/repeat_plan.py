"""Which samples are simulated a second time with half the step, and which files hold their rows.

A sample is repeated if its value in a fixed sequence lies below the share to repeat. The sequence, multiples of the
golden ratio modulo 1, fills the interval from 0 to 1 evenly from the first sample on and is in step with no sampler. So
the first samples of a campaign, however many, include their share of repeats, and a larger share or more samples keep
the repeats that already exist.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from campaign.plan_header import PlanHeader

SETTINGS = "repeated_with"  # column of a repeat: the settings that differ from those of its row
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)  # 2^64 over the golden ratio
_HALF = np.uint64(0x4F1BBCDCBFA53E0A)  # half of it: the place of sample 0
_BLOCK = 1 << 20  # samples processed together

USUAL_SHARE, LARGEST_USUAL = 0.03, 0.05  # of the samples; a repeat takes about twice the time of its run
WANTED, ENOUGH = 20, 300  # repeats: they give the variance of a difference to within a third and a twelfth


def usual_share(samples: int) -> float:
    """Return the share of the samples that a campaign repeats unless it asks for another.

    It is 3 %, raised to at most 5 % to get twenty repeats, and lowered so that there are at most 300.
    """
    return min(max(USUAL_SHARE, min(WANTED / samples, LARGEST_USUAL)), ENOUGH / samples)


def repeated_samples(samples: int, low: float, high: float) -> NDArray[np.int64]:
    """Return, in order, the samples below ``samples`` that a share ``high`` repeats and a share ``low`` does not."""
    found = [np.zeros(0, np.int64)]
    for first in range(0, samples, _BLOCK) if high > low else ():
        sample = np.arange(first, min(first + _BLOCK, samples), dtype=np.uint64)
        place = ((sample * _GOLDEN + _HALF) >> np.uint64(11)) * 2.0**-53  # 53 bits, which a float holds exactly
        found.append(sample[(place >= low) & (place < high)].astype(np.int64))
    return np.concatenate(found)


@dataclass(frozen=True)
class RepeatPlan(PlanHeader):
    """A set of repeats, which the store treats as a campaign's table in a folder of its own.

    Each of its batches holds the repeats of one batch of the campaign; batches without a repeat are left out. Rows are
    counted from 0 as in a campaign, but their sample numbers are not successive.
    """

    campaign: PlanHeader  # whose samples are repeated
    number: int  # of the set, from 1
    numbers: tuple[int, ...]  # sample of each row, in order
    campaign_batches: tuple[int, ...]  # batch of the campaign that each batch repeats

    @property
    def folder(self) -> str:
        """Name of the folder of the parts."""
        return f"repeats-{self.number}"

    @property
    def all_samples(self) -> int:
        """Number of samples of the campaign."""
        return self.campaign.samples

    @property
    def sealed_as(self) -> str:
        """Name of the table in the seals of its files."""
        return f"{self.campaign_id}/{self.folder}"

    def numbers_of(self, begin: int, end: int) -> list[int]:
        """Return the sample numbers of the rows ``begin`` to ``end - 1``."""
        return list(self.numbers[begin:end])

    def rows_before(self, end: int) -> int:
        """Return the number of rows that repeat samples below ``end``."""
        return bisect_left(self.numbers, end)

    def batch_of(self, campaign_batch: int) -> int | None:
        """Return the batch that repeats samples of a campaign's batch; None if none of its samples is repeated."""
        at = bisect_left(self.campaign_batches, campaign_batch)
        return at if self.campaign_batches[at : at + 1] == (campaign_batch,) else None


def plan_repeats(campaign: PlanHeader, shares: Sequence[float]) -> tuple[RepeatPlan, ...]:
    """Return the sets of repeats of a campaign for rising shares of its samples.

    Each set holds the repeats that its share adds to the share before it; empty sets are left out.
    """
    firsts = [first for first, _ in campaign.batches]
    columns = [*campaign.columns, {"name": SETTINGS, "type": "string", "unit": "", "nullable": False}]
    plans = []
    for number, (low, high) in enumerate(zip((0.0, *shares), shares, strict=False), 1):
        numbers = repeated_samples(campaign.samples, low, high).tolist()
        of_rows = [bisect_right(firsts, sample) - 1 for sample in numbers]
        of_batches = sorted(set(of_rows))
        begins = [*(bisect_left(of_rows, batch) for batch in of_batches), len(numbers)]
        batches = tuple((begin, end - begin) for begin, end in pairwise(begins))
        if batches:
            header = (campaign.campaign_id, campaign.title, batches, columns)
            plans.append(RepeatPlan(*header, campaign, number, tuple(numbers), tuple(of_batches)))
    return tuple(plans)
