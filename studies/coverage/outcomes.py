"""What became of an interval in each replication, and whether its coverage is what the report promises."""

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

from reporting.capability.intervals import Interval, share_interval

COVERED, LOW, HIGH, WARNED, WITHHELD = "covered", "missed low", "missed high", "warned", "withheld"
# What 95 % intervals may cover, and how sure the study must be that one does not.
LEAST, MOST = 0.92, 0.98
SURE = 0.99
# A truth that misses an interval by no more is covered: the index of a variable without effect is 0 but for rounding.
ROUNDING = 1e-9
# On normal values in no lots a warning is a false alarm; more of them fail.
FALSE_ALARMS = 0.10
# Intervals that cover at least as often as they say, by their documented construction: from whole numbers of rejects or
# values, or over all positions of the mean.
CONSERVATIVE = re.compile(
    "counted|distance from normal|yield|loss by a response|part of the rejects|contains [0-9.]+, any|Cpk, joint"
    "|what if .*: ppm|rare, |certain verdict"
)


@dataclass(frozen=True)
class Statement:
    """An interval of the page beside the truth.

    Attributes
    ----------
    number : str
        Row of the table: what the interval is of.
    interval : (float, float) or None
        None where the page has none.
    truth : float
    warned : bool
        The page says that the interval may not hold.
    """

    number: str
    interval: Interval | None
    truth: float
    warned: bool = False

    def outcome(self) -> str:
        """Return what became of the interval; it misses low if it ends below the truth."""
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
        """Share of them that cover; None without any."""
        return self.counts[COVERED] / self.answered if self.answered else None

    def fault(self, number: str, *, textbook: bool) -> str:
        """Return what is wrong beyond chance; empty if nothing is.

        Parameters
        ----------
        number : str
            What the interval is of.
        textbook : bool
            The values are normal, in no lots and many, so that a warning is a false alarm.
        """
        low, _ = share_interval(self.counts[WARNED], self.total, SURE)
        if textbook and low > FALSE_ALARMS:
            return "false alarms"
        least_answered, _ = share_interval(self.answered, self.total, SURE)
        if least_answered <= 1 - LEAST:  # the page warns or withholds: whatever holds, so few are misled
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
