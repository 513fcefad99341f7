"""Figures of a response: nothing is cut, and a sliver between far limits is shown enlarged."""

import re
from dataclasses import replace

import numpy as np
import pytest

from reporting.render.figures import convergence_figure, probability_figure
from reporting.render.histograms import response_figure
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
        [(x, width)] = re.findall(r'<rect x="([\d.]+)" y="[\d.]+" width="([\d.]+)" height="[\d.]+" fill="white"/>', svg)
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
