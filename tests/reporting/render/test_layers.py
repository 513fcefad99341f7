"""The page's three layers: a first screen, a page a response, and everything else folded."""

import re
from dataclasses import replace

import pytest

from reporting.render.html import notes_of, render_html
from tests.reporting.render.visible_words import visible_words
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table, repeats_of

MOST_WORDS, MOST_OF_A_RESPONSE = 2000, 120


@pytest.fixture(scope="module")
def page() -> str:
    table, spec = c60_table(300), c60_spec(300)
    scatter = {r.name: 0.0 for r in spec.responses} | {"FC-1": 0.2}
    return render_html(analysis_of(table, spec, repeats=repeats_of(table, 12, scatter)))


def test_two_layers_are_read_in_minutes(page) -> None:
    """2,000 words with those of the figures; of a response 120, without the ticks and names of its axes."""
    front = page.split('<section class="appendix"')[0]
    assert 300 < len(visible_words(front)) <= MOST_WORDS
    articles = re.findall(r'<article class="page".*?</article>', page, re.S)
    assert len(articles) == 6
    for article in articles:
        words = visible_words(re.sub(r"<svg.*?</svg>", "", article, flags=re.S))
        assert 30 < len(words) <= MOST_OF_A_RESPONSE, words


def test_each_response_with_limits_has_six_figures(page) -> None:
    for article in re.findall(r'<article class="page".*?</article>', page, re.S):
        labels = re.findall(r'aria-label="([^"]*)"', article)
        for what in ("Control chart", "Histogram", "Probability plot", "Index of", "Causes of", " against "):
            assert any(what in label for label in labels), what


def test_the_appendix_is_folded_and_holds_what_the_page_held(page) -> None:
    appendix = page.split('<section class="appendix"')[1]
    assert "<details open" not in appendix
    for name in ("trust", "indices", "product", "stack", "causes", "repeatability", "details", "inputs", "samples",
                 "provenance", "glossary"):  # fmt: skip
        assert f'id="{name}"' in appendix, name


def test_every_link_within_the_page_has_its_place(page) -> None:
    assert set(re.findall(r'href="#([\w-]+)"', page)) <= set(re.findall(r' id="([\w-]+)"', page))


def test_checks_that_are_good_are_counted_and_the_others_come_first(page) -> None:
    listed = page.split('<ul class="checks">')[1].split("</ul>")[0]
    shown, folded = listed.split('<details class="tally">')
    assert "attention" in shown
    assert "> good" not in shown.replace("\n", "")
    assert re.search(r"\d+ checks good", folded)


def test_a_note_is_said_once(page) -> None:
    """A note on several responses stands in one list, with their names."""
    a = analysis_of(c60_table(60), c60_spec(60))
    found, text = notes_of(a), " ".join(render_html(a).split())
    assert found.shared
    for note in found.shared:
        assert text.count(f": {note}</li>") <= 1
        assert not any(note in own for own in found.of.values())


def test_a_requirement_of_its_own_is_shown_in_each_layer() -> None:
    spec = c60_spec(60)
    strict = replace(spec.responses[0], requirement=1.67)
    page = render_html(analysis_of(c60_table(60), replace(spec, responses=(strict,))))
    assert "required 1.67" in page.split('<section class="pages"')[0]
    assert "required 1.67" in page.split('<article class="page"')[1]


def test_a_campaign_without_limits_still_has_a_table() -> None:
    spec = c60_spec(60)
    page = render_html(analysis_of(c60_table(60), replace(spec, responses=spec.responses[-1:])))
    assert "<details open><summary>1 response without limits" in page
    assert '<section class="pages"' not in page


def test_colours_of_figures_have_dark_ones(page) -> None:
    """No colour of a mark is left as it is for paper on a dark page."""
    used = set(re.findall(r'(?:fill|stroke)="(#[0-9a-f]{6})"', page.split("<body>")[1]))
    dark = set(re.findall(r'svg \[(?:fill|stroke)="(#[0-9a-f]{6})"\]', page))
    assert used <= dark
