"""The tables of studies/coverage.md, against a tenth of the study that made them."""

import re
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import pytest

from reporting.capability.intervals import share_interval
from studies.coverage.__main__ import TABLES, all_tallies, cases
from studies.coverage.outcomes import BY_INDEX, COVERED, GROUPS, faults
from tests.house import ROOT

pytestmark = pytest.mark.slow

HEADING = "## Every interval"
# A tenth is so far from the whole by chance in one of 10,000 numbers.
CHANCE = 1e-4


def documented() -> dict[tuple[str, str], list[str]]:
    """Return the cells of the document by group and production, each size's part by itself."""
    section = (ROOT / "studies" / "coverage.md").read_text("utf-8").split(HEADING)[1].split("\n## ")[0]
    cells, names = {}, []
    for line in section.splitlines():
        if line.startswith(("| intervals of |", "| response |")):
            names = [cell.strip() for cell in line.strip("| ").split("|")][1:]
        elif line.startswith("| ") and not line.startswith("| ---"):
            first, *parts = (cell.strip() for cell in line.strip()[1:-1].split("|"))
            # A tall table has its groups in the first line, and a row for each production.
            tall = names[0] in GROUPS | BY_INDEX
            cells |= {
                (name, first) if tall else (first, name): part.split(" / ")
                for name, part in zip(names, parts, strict=True)
                if part
            }
    return cells


def test_the_document_has_every_group_and_production():
    found = documented()
    assert {group for group, _ in found} == {*GROUPS, *BY_INDEX}
    productions = {production.name for productions, _, _ in TABLES for production in productions}
    assert {name for _, name in found} == productions


@pytest.mark.slow
def test_a_tenth_of_the_study():
    """It finds no fault that the document does not print in bold, and no coverage that the document does not give."""
    with ProcessPoolExecutor(2) as pool:
        tallies = all_tallies(cases(0.1), partial(pool.map, chunksize=1))
    cells, new, other = documented(), {}, {}
    for key, tally in tallies.items():
        number, production, n = key
        patterns = GROUPS | BY_INDEX
        groups = [group for group, pattern in patterns.items() if re.fullmatch(pattern, number)]
        group = next((group for group in groups if (group, production) in cells), None)
        if group is None:  # a tall table leaves out what no other shape has shown
            continue
        pattern = patterns[group]
        sizes = sorted({of for name, where, of in tallies if where == production and re.fullmatch(pattern, name)})
        text = cells[group, production][sizes.index(n)]
        if "**" not in text and faults({key: tally}):
            new[key] = faults({key: tally})[key]
        stated = re.match(r"\**(\d+)(?:–(\d+))?", text)
        if stated and tally.answered:
            low, high = share_interval(tally.counts[COVERED], tally.answered, 1 - CHANCE)
            least, most = int(stated[1]) / 100 - 0.005, int(stated[2] or stated[1]) / 100 + 0.005
            if high < least or low > most:
                other[key] = (tally.counts, text)
    assert new == {}
    assert other == {}
