"""The command of the study: it computes its rows, and those of the document again."""

import re

import pytest

from studies import c60_spread
from studies.c60_spread import HEAD, SHIPPED, lines, variants
from tests.studies.c60_spread.test_tables import table_after

pytestmark = pytest.mark.slow

PAIR = [variant for variant in variants() if variant.name == SHIPPED or variant.heading == "shared"]


def test_a_few_samples(monkeypatch):
    """Two rows, the tables that compare them, and the words that say what was computed."""
    monkeypatch.setattr(c60_spread, "RESAMPLES", 99)
    text = list(lines(PAIR, 10))
    assert text[0] == HEAD
    assert [line.split(" | ")[1] for line in text[1:3]] == ["10 of 10", "10 of 10"]
    assert sum(line.startswith("| FC-1, N |") for line in text) == 2
    assert re.search(r"first 10 samples of the campaign c60, seed 2018", text[-1])


@pytest.mark.slow
def test_the_documents_figures():
    """The study computes the document's numbers again, within what other processors change in the last digits."""
    documented = {cells[0]: cells for cells in table_after(HEAD)}
    for line in list(lines(PAIR, 200))[1:3]:
        name, ok, mean, sigma, *_ = line.strip("| ").split(" | ")
        _, ok_there, mean_there, _, bounds, *_ = documented[name]
        low, high = map(float, bounds.split(" to "))
        assert ok == ok_there
        assert float(mean) == pytest.approx(float(mean_there), abs=0.02)
        assert low <= float(sigma) <= high
