"""Histograms on pages: places of bars and limits follow the numbers, and names keep off each other and the edges."""

from itertools import pairwise

import pytest

from clearcap.web.pages.histograms import GROUND, LETTER, TOP, WIDTH, histogram_figure

BINS = {"edges": [0.0, 1.0, 2.0, 4.0], "before": [1, 3, 4], "after": None, "lsl": 0.5, "usl": 4.2}


def figure(**changes):
    """Return the figure of some bins."""
    return histogram_figure(BINS | changes)


def test_areas_are_counts():
    """The highest bar reaches the top; a bar of twice the width is half as high for its count."""
    bars = figure().bars
    areas = [w * tall for _, _, w, tall in bars]
    assert areas[0] * 3 == pytest.approx(areas[1], rel=1e-3)
    assert areas[0] * 4 == pytest.approx(areas[2], rel=1e-3)
    assert max(tall for *_, tall in bars) == GROUND - TOP
    assert all(y + tall == pytest.approx(GROUND, abs=0.02) for _, y, _, tall in bars)


def test_axis_and_limits_are_to_scale():
    """A number, an edge and a limit of one value have one place; the outline has the places of the bars."""
    found = figure(lsl=2.0, usl=4.0, after=[2.0, 2.0, 4.0])
    ticks = {float(words): x for x, words in found.ticks}
    left, _, wide, _ = found.bars[2]
    assert [each.x for each in found.limits] == [ticks[2.0], ticks[4.0]] == pytest.approx([left, left + wide], abs=0.02)
    corners = [tuple(map(float, pair.split(","))) for pair in found.after.split()]
    assert [x for x, _ in corners[1:-1:2]] == [x for x, *_ in found.bars]


@pytest.mark.parametrize("ends", [(0.155, 0.24), (118.0, 205.0), (0.0, 4.0), (-26.11, -25.93)])
def test_axis_has_two_numbers(ends):
    """Of one alone nobody reads a scale; none is over another."""
    low, high = ends
    ticks = figure(edges=[low, 0.5 * (low + high), high], before=[1, 1], lsl=None, usl=None).ticks
    assert len(ticks) >= 2
    for (x, words), (y, more) in pairwise(ticks):
        assert y - x > 0.5 * LETTER * (len(words) + len(more))


@pytest.mark.parametrize("limits", [(0.5, 4.2), (1.0, 1.001), (3.9, 4.0), (-500.0, 1.0), (-50.0, 1e6), (90.0, 100.0)])
def test_names_of_limits_are_readable(limits):
    """Each is within the drawing, none over another; a limit far from the values has an arrow and no line."""
    found = figure(lsl=limits[0], usl=limits[1])
    ends = sorted((each.middle, 0.5 * LETTER * len(each.words)) for each in found.limits)
    assert ends[0][0] - ends[0][1] >= -0.1
    assert ends[1][0] + ends[1][1] <= WIDTH + 0.1
    assert ends[1][0] - ends[0][0] >= ends[0][1] + ends[1][1]
    for each in found.limits:
        assert (each.x is None) == ("←" in each.words or "→" in each.words)
        assert each.x is None or 0 <= each.x <= WIDTH


def test_no_figure_without_values():
    assert figure(edges=[], before=[]) is None
    assert figure(edges=[1.0, 1.0], before=[3]) is None
