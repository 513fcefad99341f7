"""The tables of the study in Markdown."""

from collections.abc import Iterator, Sequence

from studies.coverage.families import Key
from studies.coverage.outcomes import COVERED, HIGH, LOW, WARNED, WITHHELD, Tally
from studies.coverage.productions import Production

# Production and least number of values of which the report should warn nobody.
TEXTBOOK = ("normal", 500)
# From this share on the table says how many intervals are warned of or withheld; and only that, above the other.
SOME, NEARLY_ALL = 0.05, 0.92


def table(tallies: dict[Key, Tally], productions: Sequence[Production]) -> Iterator[str]:
    """Yield a table with a row for each number and a column for each production: its sizes, parted by strokes."""
    names = [production.name for production in productions]
    sizes = sorted({n for _, production, n in tallies if production in names})
    yield f"| interval of | {' | '.join(names)} |"
    yield f"| --- |{' --- |' * len(names)}"
    for number in dict.fromkeys(number for number, production, _ in tallies if production in names):
        cells = []
        for name in names:
            keys = [(number, name, n) for n in sizes if (number, name, n) in tallies]
            cells.append(" / ".join(cell(tallies[key], bold=bool(fault(key, tallies[key]))) for key in keys))
        yield f"| {number} | {' | '.join(cells)} |"


def cell(tally: Tally, *, bold: bool) -> str:
    """Return the coverage in percent, with the share that is warned of or withheld."""
    without = 1 - tally.answered / tally.total
    if tally.coverage is None or without >= NEARLY_ALL:
        text = "w" if tally.counts[WARNED] >= tally.counts[WITHHELD] else "–"
    else:
        text = f"{100 * tally.coverage:.0f}" + (f" w{100 * without:.0f}" if without >= SOME else "")
    return f"**{text}**" if bold else text


def fault(key: Key, tally: Tally) -> str:
    """Return what is wrong with the intervals of a number, of a production and a size; empty if nothing is."""
    number, production, n = key
    return tally.fault(number, textbook=production == TEXTBOOK[0] and n >= TEXTBOOK[1])


def details(tallies: dict[Key, Tally]) -> Iterator[str]:
    """Yield a table with a row for each case: the counts of all outcomes, and what is at fault."""
    outcomes = (COVERED, LOW, HIGH, WARNED, WITHHELD)
    yield f"| interval of | production | n | {' | '.join(outcomes)} | fault |"
    yield f"| --- | --- | --- |{' --- |' * (len(outcomes) + 1)}"
    for key, tally in tallies.items():
        counts = " | ".join(str(tally.counts[outcome]) for outcome in outcomes)
        yield f"| {' | '.join(map(str, key))} | {counts} | {fault(key, tally)} |"


def faults(tallies: dict[Key, Tally]) -> dict[Key, str]:
    """Return what is at fault, by number, production and size."""
    found = {key: fault(key, tally) for key, tally in tallies.items()}
    return {key: text for key, text in found.items() if text}
