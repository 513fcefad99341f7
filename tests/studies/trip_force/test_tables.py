"""The tables of the study: what is near, what is counted, and the rows that stand in the document."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from studies.trip_force import (
    AT_PEAK,
    FORCE,
    GRIDS,
    MAP,
    MAPPED,
    RELEASE,
    SHIPPED,
    THRESHOLDS,
    Push,
    grid_row,
    grids,
    lines,
    misses,
    verdict,
)

pytestmark = pytest.mark.slow

PAGE = (Path(__file__).parents[3] / "studies" / "trip_force.md").read_text("utf-8")


def push(force, at_peak, release):
    """Return a test that is read alike from every force, 0.01 mm shorter from 0.5 N."""
    short = {limit: 0.01 * (limit == 0.5) for limit in THRESHOLDS}
    return Push("ok", force, {x: at_peak - y for x, y in short.items()}, {x: release - y for x, y in short.items()})


EXACT = push(FORCE, AT_PEAK, RELEASE)
FAR = push(10.0, AT_PEAK, RELEASE)
FAILED = Push(
    "not_at_rest", float("nan"), dict.fromkeys(THRESHOLDS, float("nan")), dict.fromkeys(THRESHOLDS, float("nan"))
)


def test_the_nearest_is_the_one_whose_worst_number_is_best():
    """The largest of three deviations counts; runs without numbers are no miss."""
    found = misses([(SHIPPED, FAR), (replace(SHIPPED, latch=0.1), EXACT), (SHIPPED, FAILED)])
    assert len(found) == 2 * len(THRESHOLDS)
    assert found[0].deviation == pytest.approx(0, abs=1e-12)
    assert found[0].assumed.latch == 0.1
    assert found[-1].deviation == pytest.approx(10 / FORCE - 1)


def test_a_row_counts_what_is_there():
    """Failed runs are no release, and distances are told where the force is near."""
    cells = grid_row("g", [(SHIPPED, EXACT), (SHIPPED, FAR), (SHIPPED, FAILED)]).strip("| ").split(" | ")
    assert cells[:3] == ["g", "3", "2"]
    assert cells[3] == "1.87 to 10.00"
    assert cells[5] == "0.420 to 0.420"
    assert cells[7] == "0 %"
    assert grid_row("g", [(SHIPPED, FAILED)]).strip("| ").split(" | ")[2:4] == ["0", "none"]


def test_the_verdict_keeps_what_is_not_published_apart():
    """Neither a deeper latch nor the other side of the bar counts as the paper's test; a set counts once."""
    deep, beside = replace(SHIPPED, bump_radius=0.3), replace(SHIPPED, bench="trip_lamage")
    tilted = replace(SHIPPED, angle=12.0)
    text = verdict({"a": [(SHIPPED, FAR), (beside, FAR), (tilted, FAR)], "b": [(deep, EXACT), (SHIPPED, FAR)]})
    assert [line.partition(": ")[2] for line in text[:4]] == [
        f"{n} of 1 sets give all three within 10%" for n in (0, 0, 0, 1)
    ]
    assert text[4:] == ["    - 1.87, 0.270, 0.420: bump_radius 0.3; touch at 0.1 N"]


def test_the_document_has_every_grid():
    """Its tables have the heads and all the rows of the study."""
    assert MAP in PAGE
    assert GRIDS in PAGE
    for name, sets in grids().items():
        assert re.search(rf"^\| {re.escape(name)} \| {len(sets)} \|", PAGE, re.MULTILINE), name


def test_the_documents_map():
    """The study computes the map of the document again, forces within what their history leaves open."""
    text = list(lines({MAPPED: grids()[MAPPED]}))
    start = PAGE.index(MAP) + len(MAP)
    documented = PAGE[start:].strip().splitlines()[: len(grids()[MAPPED])]
    for line, there in zip(text[1:7], documented, strict=True):
        ours, theirs = ([float(x) for x in row.strip("| ").split(" | ")] for row in (line, there))
        assert ours[0] == theirs[0]
        assert ours[1] == pytest.approx(theirs[1], rel=0.35)
        assert ours[3] == pytest.approx(theirs[3], abs=0.03)
