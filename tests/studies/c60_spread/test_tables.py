"""The tables of the study: intervals that hold, counts that are right, and the rows that stand in the document."""

import re
from pathlib import Path

import numpy as np
import pytest

from studies import c60_spread
from studies.c60_spread import (
    HEAD,
    RESPONSES,
    column,
    interval,
    mean_table,
    ratio,
    row,
    shift,
    sigma,
    sigma_table,
    variants,
)

pytestmark = pytest.mark.slow

PAGE = (Path(__file__).parents[3] / "studies" / "c60_spread.md").read_text("utf-8")
NUMBER = r"[+-]?\d+\.\d+"


def results(seed, n=40, spread=1.0):
    """Return runs whose responses are all different, and a failed one."""
    rng = np.random.default_rng(seed)
    return [*(dict(zip(RESPONSES, 10 + spread * rng.standard_normal(9), strict=True)) for _ in range(n)), {}]


def test_a_row_counts_what_is_there():
    """Failed runs are left out of mean and sigma and seen in the count."""
    runs = [{"FC-1": float(i), "FC-6": i / 10} for i in range(20)]
    cells = row("v", [*runs, {}, {}]).strip("| ").split(" | ")
    assert cells[:4] == ["v", "20 of 22", "9.50", "5.916"]
    assert cells[5:] == ["0.00 to 19.00", "0.950", "0.592"]
    low, high = map(float, cells[4].split(" to "))
    assert low < 5.916 < high
    assert row("v", [{}, *runs[:5]]) == "| v | 5 of 6 | | | | | | |"


@pytest.mark.parametrize(
    ("draw", "truth"),
    [
        (lambda rng: rng.standard_normal(200), 1.0),
        (lambda rng: rng.random(200), 12**-0.5),
        (lambda rng: rng.gamma(12, 1, 200), 12**0.5),
    ],
    ids=["normal", "uniform", "skewed"],
)
def test_the_interval_of_sigma_holds_without_normality(draw, truth, monkeypatch):
    """It covers the true sigma about as often as it says, whatever the distribution."""
    monkeypatch.setattr(c60_spread, "RESAMPLES", 399)
    rng = np.random.default_rng(8)
    covered = [low <= truth <= high for low, high in (interval(sigma, draw(rng)) for _ in range(150))]
    assert 0.88 <= np.mean(covered) <= 0.99


def test_pairs_make_a_comparison_sharp():
    """The same samples times 1.1: the ratio is certain, whatever each sigma is; so is a shift."""
    x = np.random.default_rng(2).standard_normal(100)
    assert interval(ratio, x, 1.1 * x + 1e-6 * x**2) == pytest.approx((1.1, 1.1), abs=1e-4)
    assert interval(shift, x, x + 0.5 + 1e-6 * x) == pytest.approx((0.5, 0.5), abs=1e-5)


def test_tables_of_all_responses():
    """Each response has a row with its unit, and each variant a column; failed runs of either side are left out."""
    ours = results(1)
    theirs = [{name: 3 * x for name, x in run.items()} for run in ours]
    theirs[5] = {}
    lines = sigma_table(ours, {"0.3": results(2), "shared": theirs})
    assert lines[0] == "| response | sigma with preset paper | 0.3 | shared |"
    assert [line.split(" | ")[0] for line in lines[2:]] == [f"| {name}, {unit}" for name, unit in RESPONSES.items()]
    assert all(re.search(r"\| 3\.00 \(\d\.\d\d to \d\.\d\d\) \|$", line) for line in lines[2:])
    assert f"| FC-4, mm | {sigma(column(ours, 'FC-4')[:-1]):.4f} |" in "\n".join(lines)
    means = mean_table(ours, {"shared": theirs})
    assert all(re.search(r"\| \+(19|20|21)\.\d{3,4} \(\+\d", line) for line in means[2:])


# -- the document ----------------------------------------------------------------------------------------------------


def table_after(head, page=PAGE):
    """Return the rows of the document's table with a head, cell by cell."""
    assert page.count(head) == 1
    lines = page[page.index(head) :].split("\n\n")[0].splitlines()
    return [re.split(r" \| ", line.strip("| ")) for line in lines[len(head.splitlines()) :] if set(line) - set("|- ")]


def test_the_document_has_every_variant():
    """Its table has the study's rows, in the study's order and format."""
    rows = table_after(HEAD)
    assert [cells[0] for cells in rows] == [variant.name for variant in variants()]
    interval_of = f"{NUMBER} to {NUMBER}"
    form = [r"\d+ of (200|50)", NUMBER, NUMBER, interval_of, interval_of, NUMBER, NUMBER]
    assert [cells for cells in rows if not re.fullmatch(r" \| ".join(form), " | ".join(cells[1:]))] == []
    for _, _, mean, s, bounds, extremes, *_ in rows:
        low, high = map(float, bounds.split(" to "))
        assert low <= float(s) <= high
        least, largest = map(float, extremes.split(" to "))
        assert least <= float(mean) <= largest


@pytest.mark.parametrize("title", ["sigma", "mean"])
def test_the_document_has_every_response(title):
    """Its tables of all responses have the study's rows and columns."""
    headings = [variant.heading for variant in variants() if variant.heading]
    rows = table_after(f"| response | {title} with preset paper | {' | '.join(headings)} |")
    assert [cells[0] for cells in rows] == [f"{name}, {unit}" for name, unit in RESPONSES.items()]
    form = rf"{NUMBER} \({NUMBER} to {NUMBER}\)"
    assert [c for cells in rows for c in cells[2:] if not re.fullmatch(form, c)] == []
    assert {len(cells) for cells in rows} == {2 + len(headings)}
