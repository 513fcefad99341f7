"""The tables of the study in Markdown: a short one of groups of numbers, and the counts of every case."""

import re
from collections.abc import Iterator, Sequence

from studies.coverage.families import Key
from studies.coverage.outcomes import COVERED, HIGH, LOW, WARNED, WITHHELD, Tally
from studies.coverage.productions import Production

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
    "parts of the rejects": "part of the rejects, .*",
    "what if: mean, sigma, Cpk": "what if .*: (mean|sigma|Cpk)",
    "what if: ppm": "what if .*: ppm",
    "advice: factor": "advice: factor",
    "differences of two campaigns": "difference .*|ratio .*",
    "at the stop: Cpk, mean, sigma": "at the stop: .*",
    "rare rejects": "rare, (below|above|total)",
    "rare rejects, designed": "rare, designed",
    "rare rejects, bound only": "rare, bound",
}
# Production and smallest number of values for which the report should not warn; but for a share far out in a tail it
# may say that so few values do not exclude another shape.
TEXTBOOK, CAUTIONED = ("normal", 500), ("Z.bench", "ppm expected, normal")
# Shares of warned or withheld intervals above which the table shows this share as well, or nothing else.
SOME, NEARLY_ALL = 0.05, 0.92


def table(tallies: dict[Key, Tally], productions: Sequence[Production]) -> Iterator[str]:
    """Yield a table with a row for each group of numbers and a column for each production, its sizes side by side."""
    names = [production.name for production in productions]
    sizes = sorted({n for _, production, n in tallies if production in names})
    yield f"| intervals of | {' | '.join(names)} |"
    yield f"| --- |{' --- |' * len(names)}"
    for group, pattern in GROUPS.items():
        numbers = [number for number in dict.fromkeys(key[0] for key in tallies) if re.fullmatch(pattern, number)]
        cells = []
        for name in names:
            of_sizes = [
                {key: tallies[key] for number in numbers if (key := (number, name, n)) in tallies} for n in sizes
            ]
            cells.append(" / ".join(cell(found) for found in of_sizes if found))
        if any(cells):
            yield f"| {group} | {' | '.join(cells)} |"


def cell(found: dict[Key, Tally]) -> str:
    """Return the smallest and the largest coverage of some numbers in percent; bold if one of them has a fault.

    The coverage of a number that is nearly always warned of or withheld is left out; ``w`` is the largest share of
    warned or withheld intervals of the others.
    """
    stated = [tally for tally in found.values() if tally.answered >= (1 - NEARLY_ALL) * tally.total]
    if not stated:
        warned = sum(tally.counts[WARNED] for tally in found.values())
        text = "w" if warned >= sum(tally.counts[WITHHELD] for tally in found.values()) else "–"
    else:
        coverages = [f"{100 * (tally.coverage or 0.0):.0f}" for tally in stated]
        low, high = min(coverages, key=int), max(coverages, key=int)
        without = max(1 - tally.answered / tally.total for tally in stated)
        text = (low if low == high else f"{low}–{high}") + (f" w{100 * without:.0f}" if without >= SOME else "")
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
