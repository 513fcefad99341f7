"""The goal plot: names stand on nothing else, and are left out where there is no room."""

import re
from dataclasses import replace
from itertools import combinations

import pytest

from reporting.render.goal_plot import goal_figure
from reporting.render.svg import SIZE, text_width
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table


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
