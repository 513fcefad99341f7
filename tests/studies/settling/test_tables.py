"""The tables of the study: what scatter, drift and distance are, by numbers made for it."""

import numpy as np
import pytest

from studies.c60_spread import RESPONSES
from studies.settling import Ending, cost_row, distance_table, drift, mean_table, scatter, scatter_table, sigma, values

pytestmark = pytest.mark.slow


def ending(value, status="ok"):
    """Return the end of a run whose responses are all alike."""
    responses = dict.fromkeys(RESPONSES, float(value)) if status == "ok" else {}
    return Ending(status, responses, 80, 900, 2.5, 20.0)


def made(offsets, count=400, between=1.0):
    """Return runs of samples with sigma ``between``; each run of a sample is off by its offset."""
    rng = np.random.default_rng(3)
    return {i: [ending(x + offset) for offset in offsets] for i, x in enumerate(between * rng.standard_normal(count))}


def test_scatter_is_of_the_steps_and_sigma_of_the_samples():
    """Offsets of known variance on samples of known sigma."""
    x = values(made([0.0, 0.3, 0.6, 0.9], between=2.0), range(400))["FC-2"]
    assert x.shape == (400, 4)
    assert scatter(x) == pytest.approx(np.std([0.0, 0.3, 0.6, 0.9], ddof=1))
    assert sigma(x) == pytest.approx(2.0, rel=0.1)
    assert drift(x) == pytest.approx(0.9)


def test_a_sample_with_a_failed_run_has_no_scatter():
    """It is left out, however far the others are; and it is counted."""
    runs = made([0.0, 0.1, 0.2, 0.3], count=20)
    runs[20] = [ending(50), ending(90), ending(0, "not_at_rest"), ending(0)]
    x = values(runs, runs)["FC-1"]
    assert scatter(x) == pytest.approx(np.std([0.0, 0.1, 0.2, 0.3], ddof=1))
    assert cost_row("a", runs) == "| a | 83 of 84 | 80 | 900 | 2.5 | 20 |"


def test_tables_have_all_responses():
    """One column each, and one row for each settling."""
    found = {"a": made([0.0, 0.1, 0.2, 0.3]), "b": made([0.0, 0.0, 0.0, 0.0])}
    for lines in (scatter_table(found), mean_table(found)):
        assert len(lines) == 4
        assert all(line.count("|") == 2 + len(RESPONSES) for line in lines)
        assert all(response in lines[0] for response in RESPONSES)
    assert "| 0.129 of " in scatter_table(found)[2]
    assert "(0 %) |" in scatter_table(found)[3]
    assert all(" +0.300 |" in line for line in mean_table(found)[2:3])


def test_distance_is_between_the_samples_that_both_have():
    """One settling has every fifth sample only; it is 0.25 above the other one's second length of steps."""
    limit = made([0.0, 0.5, 0.5, 0.5])
    fewer = {i: [ending(run.responses["FC-1"] + 0.75) for run in runs] for i, runs in limit.items() if i % 5 == 0}
    lines = distance_table({"limit": limit, "ours": fewer}, "limit", 1)
    assert len(lines) == 3
    assert lines[2].startswith("| ours | 0.250 (+0.250) |")
