"""Figures of a response: nothing is cut, a sliver between far limits is shown enlarged, rejects stand out."""

import re
from dataclasses import replace

import numpy as np
import pytest

from reporting.render.figures import convergence_figure, probability_figure, response_figure, scatter_figure, slope_unit
from reporting.render.html import render_html
from reporting.render.svg import LIMIT, REJECT
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table


@pytest.fixture(scope="module")
def responses():
    """Return FC-2 with its limits, with limits twelve times as wide, and with one that is far away."""
    spec = c60_spec(200)
    fc2 = spec.responses[1]
    wide = replace(fc2, lsl=fc2.target - 3.0, usl=fc2.target + 3.0)
    return [
        analysis_of(c60_table(200), replace(spec, responses=(each,), variables=())).responses[0]
        for each in (fc2, wide, replace(fc2, lsl=-90.0, usl=None))
    ]


def test_a_sliver_is_shown_enlarged(responses) -> None:
    near, *far = responses
    for figure in (response_figure, probability_figure):
        assert "enlarged" not in figure(near)
        for response in far:
            assert figure(response).count("enlarged") == 1


def test_the_enlarged_view_covers_no_limit(responses) -> None:
    for response in responses[1:]:
        svg = response_figure(response)
        [(x, width)] = re.findall(
            r'<rect x="([\d.]+)" y="[\d.]+" width="([\d.]+)" height="[\d.]+" fill="#ffffff"/>', svg
        )
        limits = re.findall(r'<polyline points="([\d.]+),[^"]*" fill="none" stroke="#a61c00"', svg)
        assert limits
        assert all(not float(x) <= float(at) <= float(x) + float(width) for at in limits)


def test_the_running_index_is_not_cut(responses) -> None:
    """The band has a different height at each of its points: where it is cut, many share the edge of the figure."""
    for response in responses:
        svg = convergence_figure(response)
        [points] = re.findall(r'<polygon points="([^"]+)"', svg)
        heights = np.array([float(point.split(",")[1]) for point in points.split()])
        assert np.count_nonzero(heights == heights.min()) <= 2
        assert np.count_nonzero(heights == heights.max()) <= 2
        frame_top, ground = 28.0, 290.0 - 46.0
        assert frame_top < heights.min() < heights.max() < ground


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
