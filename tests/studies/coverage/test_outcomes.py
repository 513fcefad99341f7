"""Outcomes: what counts as covered, and which coverage is at fault."""

from collections import Counter

import pytest

from studies.coverage.outcomes import COVERED, HIGH, LOW, WARNED, WITHHELD, Statement, Tally, tallied
from tests.each import each

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("interval", "warned", "outcome"),
    [
        ((0.9, 1.1), False, COVERED),
        ((0.5, 0.9), False, LOW),
        ((1.1, 1.5), False, HIGH),
        ((1 + 1e-15, 1.5), False, COVERED),
        ((0.5, 0.9), True, WARNED),
        (None, True, WITHHELD),
        ((float("nan"), float("nan")), False, LOW),
    ],
)
def test_each_interval_has_one_outcome(interval, warned, outcome):
    """An interval without an end covers nothing."""
    assert Statement("Cpk", interval, 1.0, warned).outcome() == outcome


@each(
    ("counts", "number", "fault"),
    [
        ({COVERED: 950, LOW: 50}, "Cpk", ""),
        ({COVERED: 880, LOW: 120}, "Cpk", "too narrow"),
        ({COVERED: 88, LOW: 12}, "Cpk", ""),  # a hundred do not tell 88 from 92
        ({COVERED: 70, HIGH: 30}, "Cpk", "too narrow"),
        ({LOW: 30}, "Cpk", "too narrow"),
        ({COVERED: 1000}, "Cpk", "too wide"),
        ({COVERED: 1000}, "counted, total", ""),
        ({COVERED: 60}, "Cpk", ""),
        ({LOW: 1, WARNED: 999}, "Cpk", ""),
        ({WITHHELD: 100}, "Cpk", ""),
    ],
)
def test_fault_beyond_chance(counts, number, fault):
    assert Tally(Counter(counts)).fault(number, textbook=False) == fault


def test_a_warning_of_what_holds_is_a_fault():
    """On normal values the report may not warn of every interval; it may withhold those that need more values."""
    assert Tally(Counter({COVERED: 570, LOW: 30, WARNED: 400})).fault("Cpk", textbook=True) == "false alarms"
    assert Tally(Counter({COVERED: 570, LOW: 30, WARNED: 400})).fault("Cpk", textbook=False) == ""
    assert Tally(Counter({WITHHELD: 1000})).fault("tail, above", textbook=True) == ""


def test_a_caution_excuses_a_narrow_interval_only_if_every_page_has_it():
    short = Counter({COVERED: 700, LOW: 300})
    assert Tally(short, cautioned=1000).fault("Cpk", textbook=False) == ""
    assert Tally(short, cautioned=900).fault("Cpk", textbook=False) == "too narrow"
    assert Tally(short, cautioned=1000).fault("ppm, fitted", textbook=False) == ""
    assert Tally(short, cautioned=1000).fault("Ppk, Z-scores, fitted", textbook=False) == "too narrow"
    statements = [Statement("Cpk", (0.0, 2.0), 1.0, cautioned=True), Statement("Cpk", (0.0, 2.0), 1.0)]
    assert tallied([statements])["Cpk"].cautioned == 1


def test_tallies_by_number():
    statements = [Statement("Cp", (0.0, 2.0), 1.0), Statement("Cpk", None, 1.0)]
    found = tallied([statements, statements[:1]])
    assert found["Cp"].counts == {COVERED: 2}
    assert (found["Cp"].coverage, found["Cpk"].coverage, found["Cpk"].total) == (1.0, None, 1)
