"""Outcome of an interval in each replication, and whether its coverage is as stated in the report."""

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

from reporting.capability.intervals import Interval, share_interval

COVERED, LOW, HIGH, WARNED, WITHHELD = "covered", "missed low", "missed high", "warned", "withheld"
# Permitted coverage of 95 % intervals, and the confidence required to report a violation.
LEAST, MOST = 0.92, 0.98
SURE = 0.99
# A true value outside by no more than this is covered: the index of a variable without effect is 0 except for rounding.
ROUNDING = 1e-9
# For normal values without lots a warning is a false alarm; a larger share of them is a fault.
FALSE_ALARMS = 0.10
# Intervals whose coverage is at least the stated one by their documented construction: from whole numbers of rejects or
# values, over all positions of the mean, or over all families that the values allow.
CONSERVATIVE = re.compile(
    "counted|distance from normal|yield|loss by a response|part of the rejects|contains [0-9.]+, |Cpk, joint"
    "|what if .*: ppm|rare, |certain verdict"
)


@dataclass(frozen=True)
class Statement:
    """An interval of the page, and the true value."""

    number: str  # row of the table: the quantity of the interval
    interval: Interval | None  # None if the page has none
    truth: float
    warned: bool = False  # the page warns that the interval may not be valid

    def outcome(self) -> str:
        """Return the outcome of the interval; it misses low if it ends below the true value."""
        if self.interval is None:
            return WITHHELD
        if self.warned:
            return WARNED
        low, high = self.interval
        rounding = ROUNDING * max(1.0, abs(self.truth))
        if low - rounding <= self.truth <= high + rounding:
            return COVERED
        return HIGH if low > self.truth else LOW


@dataclass
class Tally:
    """How often each outcome occurred for one number in one case."""

    counts: Counter[str] = field(default_factory=Counter)

    @property
    def total(self) -> int:
        """Number of replications."""
        return self.counts.total()

    @property
    def answered(self) -> int:
        """Number of intervals without a warning."""
        return sum(self.counts[outcome] for outcome in (COVERED, LOW, HIGH))

    @property
    def coverage(self) -> float | None:
        """Share of the answered intervals that cover; None without any."""
        return self.counts[COVERED] / self.answered if self.answered else None

    def fault(self, number: str, *, textbook: bool) -> str:
        """Return the fault of the interval, if it is beyond chance; empty otherwise.

        `textbook`: the values are normal, without lots and numerous, so that a warning is a false alarm.
        """
        low, _ = share_interval(self.counts[WARNED], self.total, SURE)
        if textbook and low > FALSE_ALARMS:
            return "false alarms"
        least_answered, _ = share_interval(self.answered, self.total, SURE)
        if least_answered <= 1 - LEAST:  # mostly warned of or withheld, so few readers are misled
            return ""
        low, high = share_interval(self.counts[COVERED], self.answered, SURE)
        if high < LEAST:
            return "too narrow"
        return "too wide" if low > MOST and not CONSERVATIVE.match(number) else ""


def tallied(replications: Iterable[Iterable[Statement]]) -> dict[str, Tally]:
    """Return the tally of each number over replications."""
    tallies: dict[str, Tally] = {}
    for statements in replications:
        for statement in statements:
            tallies.setdefault(statement.number, Tally()).counts[statement.outcome()] += 1
    return tallies
