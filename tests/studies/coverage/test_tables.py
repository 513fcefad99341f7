"""Tables of the coverage study: what a cell says, and that the document's are those of the study."""

from collections import Counter

import pytest

from studies.coverage.outcomes import COVERED, LOW, WARNED, WITHHELD, Tally, cell, details, table
from studies.coverage.productions import SHAPES

pytestmark = pytest.mark.slow

HOLDS, SHORT = Tally(Counter({COVERED: 950, LOW: 50})), Tally(Counter({COVERED: 700, LOW: 300}))
HALF = Tally(Counter({COVERED: 470, LOW: 30, WARNED: 500}))
SILENT, ALARMED = Tally(Counter({WITHHELD: 1000})), Tally(Counter({WARNED: 990, LOW: 10}))


def test_a_cell_has_the_range_of_its_numbers():
    """And how many are warned of; bold where an interval is at fault."""
    assert cell({("Cp", "t5", 50): HOLDS, ("Cpk", "t5", 50): HOLDS}) == "95"
    assert cell({("Cp", "t5", 50): HOLDS, ("Cpk", "t5", 50): SHORT}) == "**70–95**"
    assert cell({("Cp", "t5", 50): HOLDS, ("Cpk", "t5", 50): HALF}) == "94–95 w50"
    assert cell({("Cp", "t5", 50): HOLDS, ("Cpk", "t5", 50): ALARMED}) == "95"
    assert (cell({("Cp", "t5", 50): SILENT}), cell({("Cp", "t5", 50): ALARMED})) == ("–", "w")
    assert cell({("Cp", "normal", 500): HALF}) == "**94 w50**"


def test_a_cell_says_where_the_page_cautions():
    """Of intervals that hold too seldom; where they hold it need not be said."""
    cautioned = Tally(SHORT.counts, cautioned=1000)
    assert cell({("Cpk", "t3", 5000): cautioned}) == "70 c"
    assert cell({("Cpk", "t3", 5000): Tally(HOLDS.counts, cautioned=1000)}) == "95"


def test_a_tall_table_has_a_row_for_each_production_with_a_number():
    text = list(table({("Cpk", "t5", 50): HOLDS, ("Cpk", "gamma", 50): SHORT}, SHAPES, tall=True))
    assert text == [
        "| response | mean, sigma, Cp, Cpk, Cpl, Cpu, Cc, Cpm, Cpmk |",
        "| --- | --- |",
        "| gamma | **70** |",
        "| t5 | 95 |",
    ]


def test_a_column_has_its_sizes_side_by_side():
    tallies = {("Cpk", "t5", 50): HOLDS, ("Cpk", "t5", 500): SHORT, ("tail, above", "t5", 50): SILENT}
    text = list(table(tallies, SHAPES))
    assert text[2] == "| mean, sigma, Cp, Cpk, Cpl, Cpu, Cc, Cpm, Cpmk |  |  |  | 95 / **70** |  |  |"
    assert text[3].startswith("| Pareto tails |  |  |  | – |")


def test_details_have_every_count():
    (*_, line) = details({("Cpk", "t5", 500): SHORT})
    assert line == "| Cpk | t5 | 500 | 700 | 300 | 0 | 0 | 0 | too narrow |"
