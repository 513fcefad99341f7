"""The figures over all responses: who is in them, and where."""

import re
from dataclasses import replace
from itertools import combinations

import pyarrow as pa
import pytest

from reporting.render.html import render_html
from reporting.render.panels import goal_figure, one_sided, out_of_figures, overview_figure
from reporting.render.svg import SIZE, text_width
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table


def test_one_sided_responses_are_in_the_overview() -> None:
    """FC-6 has a lower limit alone; the page says how it is scaled, and that the goal plot lacks it."""
    analysis = analysis_of(c60_table(100), c60_spec(100))
    assert [r.spec.name for r in one_sided(analysis)] == ["FC-6"]
    assert ">FC-6 *</text>" in overview_figure(analysis)
    page = render_html(analysis)
    assert "With one limit, not shown: FC-6." in page
    assert "so that a mean at 0 has Cpk 1.33" in page


def test_a_campaign_of_one_sided_responses_has_a_figure() -> None:
    spec = c60_spec(100)
    first = replace(spec.responses[0], lsl=None, usl=16.0)
    assert ">FC-1 *</text>" in overview_figure(analysis_of(c60_table(100), replace(spec, responses=(first,))))


def test_what_no_figure_shows_is_said() -> None:
    """A constant with limits has no place between them."""
    table, spec = c60_table(100), c60_spec(100)
    at = table.schema.get_field_index("FC-2")
    analysis = analysis_of(table.set_column(at, "FC-2", pa.array([10.5] * 100)), spec)
    assert [r.spec.name for r in out_of_figures(analysis)] == ["FC-2"]
    assert "because values or spread are missing: FC-2." in render_html(analysis)


def boxes(svg: str) -> list[tuple[str, float, float]]:
    """Return the words inside the plot with their middle."""
    return [
        (words, float(x), float(y))
        for x, y, words in re.findall(r'<text x="([\d.]+)" y="([\d.]+)" text-anchor="middle"[^>]*>([^<]+)<', svg)
        if words.startswith(("Cpk", "R"))
    ]


@pytest.mark.parametrize("count", [2, 10, 30])
def test_names_keep_clear(count) -> None:
    """Of responses that all lie at one place, on the line of Cpk 1.33."""
    spec, table = c60_spec(100), c60_table(100)
    named = [replace(spec.responses[1], name=f"R{i}-response", lsl=10.58 - 0.2, usl=10.58 + 0.2) for i in range(count)]
    for each in named:
        table = table.append_column(each.name, table["FC-2"])
    found = boxes(goal_figure(analysis_of(table, replace(spec, responses=tuple(named), variables=()))))
    assert len([words for words, *_ in found if words.startswith("R")]) == count
    for (first, x, y), (second, u, v) in combinations(found, 2):
        beside = abs(x - u) >= 0.5 * (text_width(first) + text_width(second))
        assert beside or abs(y - v) >= SIZE, (first, second)
