"""The panels of a response's page: they show the numbers of the analysis, and stay within their frames."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from reporting import format_numbers
from reporting.render import panels
from reporting.render.figures import convergence_figure
from reporting.render.svg import HALF, TALL, PlotArea, limit_markers, marker, text_width, with_near
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table


@cache
def analysed(n: int = 200):
    return analysis_of(c60_table(n), c60_spec(n))


def texts(figure: str) -> list[str]:
    return re.findall(r"<text[^>]*>([^<]*)</text>", figure)


def test_every_text_lies_in_its_figure() -> None:
    a = analysed()
    for r in a.responses:
        for figure in (panels.control_chart_figure(r), panels.deciding_probability_figure(r), panels.index_figure(r),
                       panels.causes_figure(r), panels.scatters_figure(r, {})):  # fmt: skip
            if figure is None:
                continue
            width, height = map(float, re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', figure).groups())
            for x, y in re.findall(r'<text x="([-\d.]+)" y="([-\d.]+)"', figure):
                assert 0 <= float(x) <= width
                assert 0 <= float(y) <= height


def test_the_index_shows_what_decides_and_the_requirement() -> None:
    for r in analysed().responses[:6]:
        figure = panels.index_figure(r)
        assert f"required {format_numbers.plain(r.spec.requirement)}" in texts(figure)
        bold = re.findall(r'<text[^>]*font-weight="700"[^>]*>([^<]*)</text>', figure)
        if r.verdict.index is not None:
            assert format_numbers.index(r.verdict.index) in bold


def test_the_index_of_too_few_values_is_not_drawn() -> None:
    assert panels.index_figure(analysed(20).responses[0]) is None


def test_causes_show_the_shares() -> None:
    r = analysed().responses[0]
    found = texts(panels.causes_figure(r))
    for i in r.sensitivity.ranked[:6]:
        assert i.variable in found
        assert format_numbers.part(i.share) in found
    assert "share of the variance [%]" in found


@pytest.mark.parametrize(
    ("marked", "words"),
    [((), "No point breaks a rule"), ((4,), "1 point breaks a rule"), ((4, 7), "2 points break a rule")],
)
def test_marked_points_are_counted_in_words(marked, words) -> None:
    chart = replace(analysed().responses[0].chart, marks={"nelson 1": marked, "nelson 2": ()})
    assert panels.marked_words(chart) == words


def test_two_scatters_share_an_axis_and_name_limits_that_are_far() -> None:
    r = analysed().responses[0]
    figure = panels.scatters_figure(r, {v.spec.name: v.spec.unit for v in analysed().variables})
    assert {f"{s.variable} [mm]" for s in r.scatters} <= set(texts(figure))
    assert "LSL 9 is far below" in texts(figure)


def test_the_deciding_family_has_its_curve() -> None:
    """FC-6 is lognormal: the curve of the family that decides is drawn, and the normal line only beside it."""
    r = next(r for r in analysed().responses if r.spec.name == "FC-6")
    fit = panels.deciding_fit(r)
    assert fit is not None
    assert fit.family != "normal"
    assert fit.title in panels.deciding_probability_figure(r)
    normal = analysed().responses[0]
    assert panels.deciding_fit(normal) is None


def test_a_mini_histogram_has_a_bar_for_each_count_and_a_line_for_each_limit() -> None:
    r = analysed().responses[0]
    figure = panels.mini_histogram(r)
    assert figure.count("<rect") == np.count_nonzero(r.histogram.counts)
    assert figure.count("<polyline") == 3  # the ground and two limits
    assert not texts(figure)
    assert panels.mini_histogram(replace(r, histogram=None))


@pytest.mark.parametrize(("first", "last"), [(225, 300), (30, 40), (30, 35), (31, 33)])
def test_convergence_counts_samples_whatever_their_range(first, last) -> None:
    """Its axis is logarithmic; where no round power lies within, its numbers are still samples."""
    r = analysed().responses[0]
    n = tuple(range(first, last + 1))
    run = replace(r.running, n=n, value=(1.5,) * len(n), low=(1.4,) * len(n), high=(1.6,) * len(n))
    found = texts(convergence_figure(replace(r, running=run)))
    ticks = [int(word) for word in found[: found.index("samples")][-12:] if word.isdigit()]
    assert ticks
    assert all(first <= tick <= last for tick in ticks)


def test_limits_near_the_values_are_shown_and_others_are_named() -> None:
    assert with_near([10.0, 20.0], [5.0, 60.0]) == ([10.0, 20.0, 5.0], [60.0])
    assert with_near([7.0, 7.0], [7.5])[1] == []


@pytest.mark.parametrize(("low", "high"), [(4.9, 5.1), (0.0, 0.2), (9.8, 10.0), (-1.0, 11.0)])
def test_names_of_near_limits_keep_off_each_other(low, high) -> None:
    """Each beside its line, wherever both lie, and inside the figure."""
    frame = PlotArea(HALF, TALL, (-1.0, 11.0), (0.0, 1.0), left=76)
    marks = "".join(limit_markers(frame, ((high, "USL"), (low, "LSL"))))
    (first, *_), (second, *_) = placed = re.findall(r'<text x="([\d.]+)"[^>]*>([^<]*)<', marks)
    assert [words for _, words in placed] == [f"LSL {low:g}", f"USL {high:g}"]
    halves = [0.5 * text_width(words) for _, words in placed]
    assert float(second) - float(first) >= sum(halves)
    assert float(second) + halves[1] <= frame.width


def test_the_name_of_a_limit_keeps_off_the_numbers_of_the_axis() -> None:
    frame = PlotArea(HALF, TALL, (0.0, 10.0), (0.0, 1.0), left=76)
    words = "LSL 12.345"
    x = float(re.search(r'<text x="([\d.]+)"', marker(frame, 0.0, words, "#000000", "")).group(1))
    assert x - 0.5 * 0.56 * 13 * len(words) >= frame.left - 6
