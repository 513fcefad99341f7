"""The scatter plot: limits are drawn or named, rejects stand out, units are on both axes and at the slope."""

from dataclasses import replace

import pytest

from reporting.render.axes import LIMIT, REJECT
from reporting.render.html import render_html
from reporting.render.scatter_figure import scatter_figure, slope_unit
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table


@pytest.fixture(scope="module")
def figures() -> dict[str, str]:
    """Return the scatter plot of FC-1 with limits near, with one that rejects many, and far away."""
    limits = {"near": (11.0, 16.5), "rejects": (13.7, None), "far": (-90.0, None)}
    found = {}
    for name, (lsl, usl) in limits.items():
        first = replace(c60_spec(200).responses[0], lsl=lsl, usl=usl)
        response = analysis_of(c60_table(200), replace(c60_spec(200), responses=(first,))).responses[0]
        found[name] = scatter_figure(response, response.scatters[0], "mm")
    return found


def test_limits_and_units_are_there(figures) -> None:
    assert "FC-1 [N]" in figures["near"]
    assert "J1 [mm]" in figures["near"]
    assert figures["near"].count(f'stroke="{LIMIT}"') == 2
    assert "LSL 11" in figures["near"]
    assert "USL 16.5" in figures["near"]


def test_rejects_stand_out(figures) -> None:
    assert REJECT in figures["rejects"]
    assert REJECT not in figures["near"]


def test_a_limit_far_away_is_named(figures) -> None:
    """It would squeeze the points into a line."""
    assert f'stroke="{LIMIT}"' not in figures["far"]
    assert "LSL -90 is far below" in figures["far"]


@pytest.mark.parametrize(
    ("response", "variable", "unit"),
    [("N", "mm", " N/mm"), ("1", "mm", " 1/mm"), ("mm", "1", " mm"), ("1", "", ""), ("N", "N mm/rad", " N/(N mm/rad)")],
)
def test_the_unit_of_a_slope(response, variable, unit) -> None:
    assert slope_unit(response, variable) == unit


@pytest.mark.slow
def test_ten_responses_of_many_samples_stay_small() -> None:
    """The page says how many of the samples it shows, and has less than two megabytes."""
    spec = c60_spec(3_000)
    named = [replace(spec.responses[0], name=f"R{i}") for i in range(10)]
    table = c60_table(3_000)
    for each in named:
        table = table.append_column(each.name, table["FC-1"])
    page = render_html(analysis_of(table, replace(spec, responses=tuple(named))))
    assert len(page.encode()) < 2e6
    assert "of 3\u202f000 samples, drawn at random, and those of the smallest and largest values" in page
