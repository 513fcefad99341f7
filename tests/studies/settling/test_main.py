"""The command of the study: its tables, for a few samples."""

import re

import pytest

from studies.settling import CHOSEN, COSTS, LIMIT, WINDOWS, lines, settlings

pytestmark = pytest.mark.slow


def test_a_few_samples():
    """Costs, scatter and means of each settling, distances where their rows are there, and what was computed."""
    chosen = [settling for settling in settlings() if settling.name in (CHOSEN, *WINDOWS)]
    text = list(lines(chosen, 6))
    assert text[0] == COSTS
    assert [line.split(" | ")[1] for line in text[1:4]] == ["24 of 24", "8 of 8", "8 of 8"]
    assert sum(line.startswith(f"| {CHOSEN} |") for line in text) == 3
    assert sum(line.startswith(f"| {WINDOWS[0]} |") for line in text) == 4
    assert not any(line.startswith(f"| {LIMIT}") for line in text)
    assert re.search(r"first 6 samples of the campaign c60, seed 2018, four lengths of steps", text[-1])
