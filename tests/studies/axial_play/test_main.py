"""The command of the study: its table for a few samples, and the document's figures."""

import re

import numpy as np
import pytest

from engine import load_mechanism, simulate
from studies.axial_play import CENTRED, HEAD, SHIPPED, lines, plays, row, run
from studies.c60_spread import RESPONSES
from tests.house import ROOT
from tests.studies.c60_spread.test_tables import table_after

pytestmark = pytest.mark.slow

BY_NAME = {play.name: play for play in plays()}
GAPS = {f"J{i}": 0.06 for i in range(1, 8)}


def test_a_few_samples():
    """Both settlings of the first two starts, and the words that say what was computed."""
    text = list(lines([BY_NAME[SHIPPED], BY_NAME[CENTRED]], 10))
    assert text[0] == HEAD
    assert [line.split(" | ")[1:3] for line in text[1:5]] == 2 * [["drag", "10 of 10"], ["free fall", "10 of 10"]]
    assert re.search(r"first 10 samples of the campaign c60, seed 2018", text[-1])


def test_a_run_is_that_of_the_mechanism():
    """The shipped start gives what the mechanism file gives, and `centred` what its preset gives."""
    c60 = load_mechanism("c60")
    assert run(BY_NAME[SHIPPED], False, 0, GAPS) == simulate(c60, GAPS).responses
    assert run(BY_NAME[SHIPPED], True, 0, GAPS) == simulate(c60, c60.preset("paper") | GAPS).responses
    assert run(BY_NAME[CENTRED], False, 0, GAPS) == simulate(c60, c60.preset("centred") | GAPS).responses


def test_a_row_is_of_the_runs_that_are_ok():
    """Mean, sigma and width of the band by numpy; runs without responses are counted and left out."""
    rng = np.random.default_rng(4)
    made = [dict.fromkeys(RESPONSES, x) | {"FC-1_low": x - 0.2, "FC-1_high": x + 0.1} for x in rng.normal(12, 0.1, 50)]
    force = np.array([found["FC-1"] for found in made])
    cells = row("a | drag", [*made, {}]).strip("| ").split(" | ")
    assert cells[:5] == ["a", "drag", "50 of 51", f"{force.mean():.2f}", f"{force.std(ddof=1):.3f}"]
    assert cells[6] == "0.300"
    low, high = map(float, cells[5].split(" to "))
    assert low < force.std(ddof=1) < high
    assert row("b | drag", made[:5]) == "| b | drag | 5 of 5 | | | | | | | |"


@pytest.mark.slow
def test_the_documents_figures():
    """The study computes the document's numbers again, within what other processors change in the last digits."""
    page = (ROOT / "studies" / "axial_play.md").read_text("utf-8")
    documented = {cells[0]: cells for cells in table_after(HEAD, page) if cells[1] == "drag"}
    for name in (SHIPPED, CENTRED):
        text = lines([BY_NAME[name]], 200)
        assert next(text) == HEAD
        found = next(text).strip("| ").split(" | ")
        low, high = map(float, documented[name][5].split(" to "))
        assert found[2] == documented[name][2]
        assert float(found[3]) == pytest.approx(float(documented[name][3]), abs=0.02)
        assert low <= float(found[4]) <= high
