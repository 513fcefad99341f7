"""Outcome of an interval in each replication, whether its coverage is as the report states, and the tables of both."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from reporting.capability.intervals import Interval, share_interval
from studies.coverage.productions import Production

Key = tuple[str, str, int]  # of a tally: number, production, size
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
# Numbers of which a caution explains that an interval ends below the true value, or begins above it: with parts that
# the values may miss an index is lower, a share beyond a limit larger, and less lies within an interval.
EXPLAINED = {LOW: "(?!Ppk?,|contains)", HIGH: "(?!ppm, fitted|tail)"}


@dataclass(frozen=True)
class Statement:
    """An interval of the page, and the true value."""

    number: str  # row of the table: the quantity of the interval
    interval: Interval | None  # None if the page has none
    truth: float
    warned: bool = False  # the page warns that the interval may not be valid
    cautioned: bool = False  # the page says what the values may not show, and that the interval would be too narrow

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
    cautioned: int = 0  # answered intervals with a caution

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

    @property
    def narrow(self) -> bool:
        """Whether the answered intervals cover too seldom, by more than chance explains."""
        return self.answered > 0 and share_interval(self.counts[COVERED], self.answered, SURE)[1] < LEAST

    def excused(self, number: str) -> bool:
        """Whether nearly every page with the interval says what values may not show, and this explains the misses."""
        others = [self.counts[outcome] for outcome in (LOW, HIGH) if not re.match(EXPLAINED[outcome], number)]
        return self.cautioned >= LEAST * self.answered and sum(others) <= (1 - LEAST) * self.answered

    def fault(self, number: str, *, textbook: bool) -> str:
        """Return the fault of the interval, if it is beyond chance; empty otherwise."""
        # `textbook`: the values are normal, without lots and numerous, so that a warning is a false alarm.
        low, _ = share_interval(self.counts[WARNED], self.total, SURE)
        if textbook and low > FALSE_ALARMS:
            return "false alarms"
        least_answered, _ = share_interval(self.answered, self.total, SURE)
        if least_answered <= 1 - LEAST:  # mostly warned of or withheld, so few readers are misled
            return ""
        if self.narrow:
            return "" if self.excused(number) else "too narrow"
        low, _ = share_interval(self.counts[COVERED], self.answered, SURE)
        return "too wide" if low > MOST and not CONSERVATIVE.match(number) else ""


def tallied(replications: Iterable[Iterable[Statement]]) -> dict[str, Tally]:
    """Return the tally of each number over replications."""
    tallies: dict[str, Tally] = {}
    for statements in replications:
        for statement in statements:
            tally = tallies.setdefault(statement.number, Tally())
            outcome = statement.outcome()
            tally.counts[outcome] += 1
            tally.cautioned += statement.cautioned and outcome not in (WARNED, WITHHELD)
    return tallies


# Rows of the short table, each for the numbers whose full name matches.
GROUPS = {
    "mean, sigma, Cp, Cpk, Cpl, Cpu, Cc, Cpm, Cpmk": r"mean|sigma|Cp|Cpk|Cpl|Cpu|Cc|Cpm\*?|Cpmk",
    "joint Cpk": "Cpk, joint",
    "certain verdicts": "certain verdict, [a-z]+( capable)?",
    "certain verdicts, in turn": "certain verdict, in turn",
    "Z.bench, ppm expected": "Z.bench|ppm expected, normal",
    "Cp within lots": "Cp within lots",
    "counted shares, yields": "counted, .*|yield.*|loss by a response",
    "Pp, Ppk, ppm of fitted families": "Ppk?, .*, fitted|ppm, fitted",
    "Pp, Ppk of the values' percentiles": "Ppk?, empirical",
    "Pareto tails": "tail, .*",
    "distance from normal": "distance from normal",
    "tolerance intervals, normal": "contains .*, normal, .*",
    "tolerance intervals, any distribution": "contains .*, any, .*",
    "first-order indices": "first order, .*",
    "share of interactions": "interactions",
    "parts of the rejects": "part of the rejects, .*",
    "what if: mean, sigma, Cpk": "what if .*: (mean|sigma|Cpk)",
    "what if: ppm": "what if .*: ppm",
    "advice: factor": "advice: factor",
    "allocation: Cpk": "allocation: Cpk",
    "differences of two campaigns": "difference .*|ratio .*",
    "at the stop: Cpk, mean, sigma": "at the stop: .*",
    "rare rejects": "rare, (below|above|total)",
    "rare rejects, designed": "rare, designed",
    "rare rejects, bound only": "rare, bound",
}
# Of these a tall table has a column for each index of the worse side.
BY_INDEX = {
    "certain verdicts, index 0.90": "certain verdict, not capable",
    "certain verdicts, index 1.20": "certain verdict, marginal",
    "certain verdicts, index 1.67": "certain verdict, capable",
}
# Production and smallest number of values for which the report should not warn; but for a share far out in a tail it
# may say that so few values do not exclude another shape.
TEXTBOOK, CAUTIONED = ("normal", 500), ("Z.bench", "ppm expected, normal")
# Shares of warned or withheld intervals above which the table shows this share as well, or nothing else.
SOME, NEARLY_ALL = 0.05, 0.92


def table(
    tallies: dict[Key, Tally],
    productions: Sequence[Production],
    groups: Sequence[str] = tuple(GROUPS),
    *,
    tall: bool = False,
) -> Iterator[str]:
    """Yield a table with a row for each group of numbers and a column for each production, its sizes side by side.

    A tall one has a row for each production.
    """
    names = [production.name for production in productions]
    sizes = sorted({n for _, production, n in tallies if production in names})
    rows = []
    for group in groups:
        pattern = (GROUPS | BY_INDEX)[group]
        numbers = [number for number in dict.fromkeys(key[0] for key in tallies) if re.fullmatch(pattern, number)]
        cells = []
        for name in names:
            of_sizes = [
                {key: tallies[key] for number in numbers if (key := (number, name, n)) in tallies} for n in sizes
            ]
            cells.append(" / ".join(cell(found) for found in of_sizes if found))
        if any(cells):
            rows.append((group, *cells))
    lines = [("response" if tall else "intervals of", *names), *rows]
    if tall:
        lines = [line for line in zip(*lines, strict=True) if any(line[1:])]
    for k, line in enumerate(lines):
        yield f"| {' | '.join(line)} |"
        if not k:
            yield f"| --- |{' --- |' * (len(line) - 1)}"


def cell(found: dict[Key, Tally]) -> str:
    """Return the smallest and the largest coverage of some numbers in percent; bold if one of them has a fault."""
    # The coverage of a number that is nearly always warned of or withheld is left out; ``w`` is the largest share of
    # warned or withheld intervals of the others.
    stated = {key: tally for key, tally in found.items() if tally.answered >= (1 - NEARLY_ALL) * tally.total}
    if not stated:
        warned = sum(tally.counts[WARNED] for tally in found.values())
        text = "w" if warned >= sum(tally.counts[WITHHELD] for tally in found.values()) else "–"
    else:
        coverages = [f"{100 * (tally.coverage or 0.0):.0f}" for tally in stated.values()]
        low, high = min(coverages, key=int), max(coverages, key=int)
        without = max(1 - tally.answered / tally.total for tally in stated.values())
        text = (low if low == high else f"{low}–{high}") + (f" w{100 * without:.0f}" if without >= SOME else "")
        text += " c" if any(tally.narrow and tally.excused(key[0]) for key, tally in stated.items()) else ""
    return f"**{text}**" if faults(found) else text


def details(tallies: dict[Key, Tally]) -> Iterator[str]:
    """Yield a table with a row for each case: the counts of all outcomes, and the fault."""
    outcomes = (COVERED, LOW, HIGH, WARNED, WITHHELD)
    yield f"| interval of | production | n | {' | '.join(outcomes)} | fault |"
    yield f"| --- | --- | --- |{' --- |' * (len(outcomes) + 1)}"
    for key, tally in tallies.items():
        counts = " | ".join(str(tally.counts[outcome]) for outcome in outcomes)
        yield f"| {' | '.join(map(str, key))} | {counts} | {_fault(key, tally)} |"


def faults(tallies: dict[Key, Tally]) -> dict[Key, str]:
    """Return the faults by number, production and size."""
    found = {key: _fault(key, tally) for key, tally in tallies.items()}
    return {key: text for key, text in found.items() if text}


def _fault(key: Key, tally: Tally) -> str:
    """Return the fault of the intervals of a number, for a production and a size; empty without a fault."""
    number, production, n = key
    textbook = production == TEXTBOOK[0] and n >= TEXTBOOK[1] and number not in CAUTIONED
    return tally.fault(number, textbook=textbook)
