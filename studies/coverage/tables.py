"""The tables of the study in Markdown."""

from collections.abc import Iterator, Sequence

from studies.coverage.families import Key
from studies.coverage.outcomes import COVERED, HIGH, LOW, WARNED, WITHHELD, Tally
from studies.coverage.productions import Production

TEXTBOOK = "normal"
# From this share on the table says how many intervals are warned of or withheld; and only that, above the other.
SOME, NEARLY_ALL = 0.05, 0.90


def table(tallies: dict[Key, Tally], productions: Sequence[Production]) -> Iterator[str]:
    """Yield a table with a row for each number and a column for each production: its sizes, parted by strokes."""
    names = [production.name for production in productions]
    sizes = sorted({n for _, production, n in tallies if production in names})
    yield f"| interval of | {' | '.join(names)} |"
    yield f"| --- |{' --- |' * len(names)}"
    for number in dict.fromkeys(number for number, production, _ in tallies if production in names):
        cells = []
        for name in names:
            of_sizes = [tallies.get((number, name, n)) for n in sizes]
            cells.append(" / ".join(cell(number, name, tally) for tally in of_sizes if tally))
        yield f"| {number} | {' | '.join(cells)} |"


def cell(number: str, production: str, tally: Tally) -> str:
    """Return the coverage in percent, with the share that is warned of or withheld; bold where it is at fault."""
    without = 1 - tally.answered / tally.total
    if tally.coverage is None or without >= NEARLY_ALL:
        text = "w" if tally.counts[WARNED] >= tally.counts[WITHHELD] else "–"
    else:
        text = f"{100 * tally.coverage:.0f}" + (f" w{100 * without:.0f}" if without >= SOME else "")
    return f"**{text}**" if tally.fault(number, textbook=production == TEXTBOOK) else text


def details(tallies: dict[Key, Tally]) -> Iterator[str]:
    """Yield a table with a row for each case: the counts of all outcomes, and what is at fault."""
    outcomes = (COVERED, LOW, HIGH, WARNED, WITHHELD)
    yield f"| interval of | production | n | {' | '.join(outcomes)} | fault |"
    yield f"| --- | --- | --- |{' --- |' * (len(outcomes) + 1)}"
    for (number, production, n), tally in tallies.items():
        counts = " | ".join(str(tally.counts[outcome]) for outcome in outcomes)
        fault = tally.fault(number, textbook=production == TEXTBOOK)
        yield f"| {number} | {production} | {n} | {counts} | {fault} |"


def faults(tallies: dict[Key, Tally]) -> dict[Key, str]:
    """Return what is at fault, by number, production and size."""
    found = {key: tally.fault(key[0], textbook=key[1] == TEXTBOOK) for key, tally in tallies.items()}
    return {key: fault for key, fault in found.items() if fault}
