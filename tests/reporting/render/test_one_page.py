"""The summary to sign: one page whatever the number of responses and the length of names, the worst first."""

import re
from dataclasses import replace
from functools import cache
from html import unescape
from html.parser import HTMLParser

import pytest

from reporting.analysis import Analysis
from reporting.render.one_page import CHECKS, ROWS, cut, render_one_page
from reporting.spec import DrawnWords, LegendEntry, MechanismDrawing
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table

LONG = "a very long name of something that nobody wants to read to its end, <b>bold</b> & more " * 6


class Cells(HTMLParser):
    """Collects the heads of the table's rows."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.heads, self.inside = [], False
        self.feed(page)

    def handle_starttag(self, tag, attributes) -> None:
        """Begin the head of a row."""
        if tag == "th" and dict(attributes).get("scope") == "row":
            self.heads, self.inside = [*self.heads, ""], True

    def handle_endtag(self, tag) -> None:
        """End it."""
        self.inside = self.inside and tag != "th"

    def handle_data(self, data) -> None:
        """Add to it."""
        if self.inside:
            self.heads[-1] += data


@cache
def crowded(count: int, words: str) -> Analysis:
    """Return the analysis of many responses with long texts, FC-1 with ever closer limits."""
    spec, table = c60_spec(200), c60_table(200, 9)
    responses = []
    for i in range(count):
        name = f"R{i} {words}"
        table = table.append_column(name, table["FC-1"])
        responses.append(replace(spec.responses[0], name=name, title=words, usl=16.0 - 0.04 * i, source=words))
    drawing = MechanismDrawing(480.0, 460.0, 13.0, (), (), (), (DrawnWords(240.0, 200.0, ("R0",), "#0072B2", True),),
                               (LegendEntry("R0", words, words, "#0072B2"),))  # fmt: skip
    spec = replace(
        spec,
        title=words or "demo",
        responses=tuple(responses),
        variables=spec.variables[:2],
        header={f"{i} {words}": words for i in range(20)},
        author=words,
        ended="2026-01-01 00:00 UTC",
        written="2026-01-02 00:00 UTC",
        drawing=drawing,
    )
    return analysis_of(table, spec)


@pytest.mark.slow
@pytest.mark.parametrize(("count", "words"), [(1, ""), (1, LONG), (5, LONG), (8, LONG), (12, LONG)])
def test_it_is_one_page_of_a4(count, words) -> None:
    weasyprint = pytest.importorskip("weasyprint")
    page = render_one_page(crowded(count, words))
    assert len(weasyprint.HTML(string=page).render().pages) == 1


def test_the_worst_come_first_and_the_rest_is_counted() -> None:
    page = render_one_page(crowded(12, "name"))
    heads = [head.split()[0] for head in Cells(page).heads][:ROWS]
    assert heads == [f"R{i}" for i in range(11, 3, -1)]
    assert "Further responses with limits, all of them better: 4 " in " ".join(page.split())


def test_it_has_what_is_signed() -> None:
    """Who, when, how many failed, the yield, the causes, what asks for attention, and lines to sign."""
    page = " ".join(render_one_page(crowded(12, "name")).split())
    for words in ("2026-01-01 00:00 UTC", "2026-01-02 00:00 UTC", "<strong>9 failed</strong>", "Yield of the product",
                  "<strong>Largest causes</strong>", "J1", "What needs attention", "<strong>Failures</strong>",
                  "Made by", "Signature", "Content-Security-Policy"):  # fmt: skip
        assert words in page, words
    assert page.count("<dd>name</dd>") == 5  # of twenty lines of the header four, and the author


def test_no_text_of_a_usual_campaign_ends_in_dots() -> None:
    """Each check says what it says first; limits have their source and the requirement, rows a distribution."""
    spec = c60_spec(200)
    strict = replace(spec.responses[1], requirement=1.67)
    a = analysis_of(c60_table(200, 9), replace(spec, responses=(spec.responses[0], strict, *spec.responses[2:])))
    page = " ".join(unescape(render_one_page(a)).split())
    assert "…" not in page.split("<body")[1]
    assert page.count('aria-label="Distribution of') == 6
    assert page.count('aria-label="Goal plot') == 1
    assert 'data-label="Required">1.67</td>' in page
    assert "<strong>Source of the limits</strong>: FC-" in page
    assert "assumption of this project: no limits are published" in page
    concerns = [check for check in a.trust if check.level in ("bad", "attention")]
    assert concerns
    for check in concerns[:CHECKS]:
        shown = page.split(f"<strong>{check.name}</strong>: ")[1].split("</li>")[0].strip()
        assert shown.endswith(".")
        assert " ".join(check.text.split()).startswith(re.split(r" \(|[:.]", shown)[0])


def test_too_many_names_in_the_outcome_are_counted() -> None:
    page = render_one_page(replace(crowded(12, "name"), headline="Not capable: R1, R2, and so on. " * 20))
    assert re.search(r'<p class="headline">Of 12 responses with limits: \d+ [a-z ]+', page)


@pytest.mark.parametrize(
    ("words", "most", "text"),
    [("one two", 7, "one two"), ("one two three", 8, "one two…"), ("one. Two", 7, "one…"), ("oneword", 4, "one…")],
)
def test_a_text_is_cut_after_a_whole_word(words, most, text) -> None:
    assert cut(words, most) == text


def test_names_are_no_markup() -> None:
    assert "<b>" not in render_one_page(crowded(12, LONG))


def test_a_campaign_without_limits_has_one_too() -> None:
    """There is nothing to judge, and the page says so."""
    spec = c60_spec(50)
    free = replace(spec, responses=(replace(spec.responses[0], lsl=None, usl=None),))
    page = render_one_page(analysis_of(c60_table(50), free))
    assert "No response has limits, so there is nothing to judge." in page
    assert "Without limits: 1 response." in page
