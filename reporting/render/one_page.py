"""The summary to sign: the outcome of a report on one A4 page, for any number of responses."""

from collections import Counter

from reporting.analysis import Analysis
from reporting.capability.verdict import WORST_FIRST
from reporting.format_numbers import index, part
from reporting.key_findings import short_form
from reporting.render.figures import mechanism_figure
from reporting.render.html import MARKS, as_markup, environment, label_cells
from reporting.render.panels import goal_figure
from reporting.response import ResponseAnalysis
from reporting.trust.checks import Check

# Capacity of the page in rows and in letters; the rest is counted, and is in the report.
ROWS, CHECKS, FIELDS, CAUSES = 8, 5, 4, 3
FIELDS_OF_PARTS = 12  # there is no drawing of a mechanism
LONGEST = {"title": 140, "headline": 260, "field": 90, "name": 30, "words": 60}
SOURCE_LETTERS, CHECK_LETTERS = 420, 160  # of all sources of limits, and of one check
_ORDER = ("no verdict", *WORST_FIRST, "constant", "capable")


def render_one_page(analysis: Analysis) -> str:
    """Return the summary of an analysis as one page of HTML, for the browser and for paper."""
    limited = [r for r in analysis.responses if r.spec.lsl is not None or r.spec.usl is not None]
    ranked = sorted(limited, key=_how_bad)
    shown, others = ranked[:ROWS], ranked[ROWS:]
    concerns = [check for check in analysis.trust if check.level in ("bad", "attention")]
    concerns.sort(key=lambda check: check.level != "bad")
    drawing = analysis.spec.drawing
    return label_cells(
        environment()
        .get_template("one_page.html.j2")
        .render(
            a=analysis,
            headline=_headline(analysis.headline, limited),
            title=_cut(analysis.spec.title, "title"),
            fields=[(_cut(n, "name"), _cut(text, "field")) for n, text in analysis.spec.header.items()][
                : FIELDS_OF_PARTS if analysis.spec.measured else FIELDS
            ],
            author=_cut(analysis.spec.author, "field"),
            shown=[(r, _cut(r.spec.name, "name"), _cut(r.spec.title, "words")) for r in shown],
            sources=_sources(shown),
            goal=as_markup(goal_figure(analysis)),
            others=_counted(others),
            unlimited=len(analysis.responses) - len(limited),
            concerns=[(check, _concern(check)) for check in concerns[:CHECKS]],
            more_concerns=len(concerns) - CHECKS,
            checked=len(analysis.trust),
            causes=_causes(ranked),
            mechanism=as_markup(mechanism_figure(drawing) if drawing else None),
            marks=MARKS,
        )
    )


def _how_bad(response: ResponseAnalysis) -> tuple[int, float]:
    """Return the sort key of a response: by verdict, the worst first, then by index."""
    word = response.verdict.word + (", not certain" if response.verdict.certain is False else "")
    place = _ORDER.index(word) if word in _ORDER else 0
    return place, float("-inf") if response.index is None else response.index


def _counted(others: list[ResponseAnalysis]) -> str:
    """Return the number of omitted responses by verdict."""
    counts = Counter(r.verdict.word for r in others)
    return ", ".join(f"{count} {word}" for word, count in counts.items())


def _causes(ranked: list[ResponseAnalysis]) -> list[str]:
    """Return the main causes of variation of the worst responses."""
    found = []
    for r in ranked:
        known = [i for i in (r.sensitivity.ranked if r.sensitivity else ()) if i.share][:2]
        if known:
            shares = ", ".join(f"{_cut(i.variable, 'name')} {part(i.share)}" for i in known)
            cpk = "" if r.index is None else f" (index {index(r.index)})"
            found.append(f"{_cut(r.spec.name, 'name')}{cpk}: {shares}")
    return found[:CAUSES]


def _headline(headline: str, limited: list[ResponseAnalysis]) -> str:
    """Return the headline; with too many names for the page, how many responses have each verdict."""
    if len(headline) <= LONGEST["headline"]:
        return headline
    return f"Of {len(limited)} responses with limits: {_counted(limited)}." if limited else _cut(headline, "headline")


def _sources(shown: list[ResponseAnalysis]) -> list[tuple[str, str]]:
    """Return the sources of the limits, each once with its responses; those that do not fit are in the report."""
    names: dict[str, list[str]] = {}
    for r in shown:
        names.setdefault(r.spec.source or "not stated", []).append(_cut(r.spec.name, "name"))
    found, room = list[tuple[str, str]](), SOURCE_LETTERS
    for source, those in names.items():
        listed = "all" if len(those) == len(shown) > 1 else ", ".join(those)
        room -= len(listed) + len(source)
        if room < 0:
            return [*found, ("others", "in the report")]
        found.append((listed, source))
    return found


def _concern(check: Check) -> str:
    """Return what a check says first; its name must do where even that is long."""
    words = short_form(check.text)
    return words if len(words) <= CHECK_LETTERS else "see the report."


def _cut(words: str, kind: str) -> str:
    """Return a text that fits on the page; a longer text ends in dots."""
    return cut(words, LONGEST[kind])


def cut(words: str, most: int) -> str:
    """Return a text of at most `most` letters; a longer text is cut after a whole word and ends in dots."""
    if len(words) <= most:
        return words
    kept = words[: most - 1]
    whole = kept if words[most - 1].isspace() else kept.rpartition(" ")[0]
    return f"{(whole or kept).rstrip(' ,;:.')}…"
