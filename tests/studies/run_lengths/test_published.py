"""Run lengths by simulation beside published ones, and the table of studies/run_lengths.md beside the study."""

import re

import pytest

from studies.run_lengths import CHARTS, SHIFTS, run_length
from tests.house import ROOT

# Champ and Woodall (1987, Technometrics 29, 393-399), table 1, rules 1, 12, 13, 14, 1234; Lucas and Saccucci (1990,
# Technometrics 32, 1-12): 500 of a stable process.
PUBLISHED = {
    "beyond 3 sigma alone": 370.40,
    "Western Electric 1, 2": 225.44,
    "Western Electric 1, 3": 166.05,
    "Western Electric 1, 4": 152.73,
    "Western Electric 1 to 4": 91.75,
    "EWMA, weight 0.2, 2.962 sigma": 500.0,
    "EWMA, weight 0.1, 2.814 sigma": 500.0,
}
PROCESSES = 4000


@pytest.mark.slow
def test_the_published_run_lengths():
    """To 7 %: four standard errors of 4,000 processes."""
    for chart, expected in PUBLISHED.items():
        assert run_length(chart, 0.0, PROCESSES) == pytest.approx(expected, rel=0.07), chart
    assert run_length("beyond 3 sigma alone", 1.0, PROCESSES) == pytest.approx(43.89, rel=0.07)


@pytest.mark.slow
def test_the_table_of_the_documentation():
    text = (ROOT / "studies" / "run_lengths.md").read_text("utf-8").split("python -m studies.run_lengths")[1]
    rows = dict(re.findall(r"^\| (?!tests|---)(.+?) \| (.+) \|$", text, re.M))
    assert set(CHARTS) <= set(rows)
    for chart in CHARTS:
        shown = [float(cell) for cell in rows[chart].split(" | ")]
        for shift, length in zip(SHIFTS, shown, strict=True):
            assert run_length(chart, shift, PROCESSES) == pytest.approx(length, rel=0.09), (chart, shift)
