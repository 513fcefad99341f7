"""The report as one self-contained page with inline style and figures, without scripts and requests.

A content security policy enforces this in the browser: the page runs no script, loads nothing and sends nothing. The
only style sheet it allows is the page's own.

On a telephone a row of a wide table becomes a card, one cell below the other, so that nothing is cut off: each cell has
the name of its column, which the style sheet shows instead of the head.
"""

import re
from dataclasses import dataclass
from functools import cache
from itertools import groupby
from operator import attrgetter

from jinja2 import Environment
from markupsafe import Markup

from reporting import format_numbers
from reporting.analysis import Analysis
from reporting.capability.indices import NAMES, SIX_SIGMA_SHIFT, WHICH_SIGMA
from reporting.capability.shares import largest_z, least_ppm, runs_to_claim
from reporting.capability.verdict import CAPABLE, MARGINAL
from reporting.key_findings import DECIDING, first_sentence, key_findings, short_form
from reporting.render import figures, panels
from reporting.render.figures import mechanism_figure
from reporting.render.page_templates import page_environment
from reporting.render.svg import DARK, unit_suffix
from reporting.response import CLAIM_PPM, ResponseAnalysis
from reporting.samples import too_few_ok
from reporting.sensitivity.influence import CRITICAL_SHARE

WIDE = 2  # columns; wider tables become cards on a narrow screen
_TABLE = re.compile(r"<table\b[^>]*>.*?</table>", re.S)
_ROW = re.compile(r"<tr\b[^>]*>.*?</tr>", re.S)
_CELL = re.compile(r"<(t[dh])\b([^>]*)>(.*?)</\1>", re.S)
_TAG = re.compile(r"<[^>]*>")
MARKS = {
    "capable": "✓",
    "marginal": "!",
    "not capable": "✗",
    "no verdict": "?",
    "constant": "=",
    "no limits": "–",
    "good": "✓",
    "attention": "!",
    "bad": "✗",
    "info": "i",
}
METHODS = {
    "percentile": "percentiles (ISO 22514-2, Clements)",
    "z_score": "Z-scores (Minitab)",
    "empirical": "the values' own percentiles (Cnpk)",
}
# Sections that the sentences of the first screen stand for.
PLACES = {"Worst": "summary", "Yield": "product", "Causes": "causes", "Tolerances": "advice", "Trust": "trust"}
CLAIMS = (1000.0, 100.0, CLAIM_PPM, 10.0, 1.0)


def render_html(analysis: Analysis, files: tuple[str, ...] = ("capability.json",), missing: str = "") -> str:
    """Return the page of an analysis, the same text for the same analysis."""
    # `files` are the names of the files next to the page; `missing` names omitted files, and how to get them.
    limited = [r for r in analysis.responses if r.spec.lsl is not None or r.spec.usl is not None]
    # Figures escape their own texts and are marked as safe; the templates escape everything else.
    return label_cells(
        environment()
        .get_template("report.html.j2")
        .render(
            a=analysis,
            findings=key_findings(analysis),
            places=PLACES,
            limited=limited,
            unlimited=[r for r in analysis.responses if r not in limited],
            no_verdict=too_few_ok(analysis.ok, _judged(analysis), analysis.spec.min_ok),
            notes=notes_of(analysis),
            units={v.spec.name: v.spec.unit for v in analysis.variables},
            marks=MARKS,
            methods=METHODS,
            names=NAMES,
            which_sigma=WHICH_SIGMA,
            shift=SIX_SIGMA_SHIFT,
            capable=CAPABLE,
            marginal=MARGINAL,
            critical=CRITICAL_SHARE,
            claims=[(ppm, runs_to_claim(ppm, analysis.confidence)) for ppm in CLAIMS],
            overview=as_markup(panels.overview_figure(analysis)),
            goal=as_markup(panels.goal_figure(analysis)),
            one_sided=panels.one_sided(analysis),
            out_of_figures=panels.out_of_figures(analysis),
            mechanism=as_markup(mechanism_figure(analysis.spec.drawing) if analysis.spec.drawing else None),
            files=files,
            missing=missing,
        )
    )


def _judged(analysis: Analysis) -> int:
    """Return the number of finished samples but for those that are judged by a limit of their own."""
    apart = analysis.assembly is not None and analysis.assembly.limit is not None
    return analysis.finished - (analysis.assembly.count if apart and analysis.assembly else 0)


@dataclass(frozen=True)
class Notes:
    """The notes on the responses' numbers, equal ones of several responses as one."""

    of: dict[str, tuple[str, ...]]  # by response: those of this response alone
    shared: dict[str, tuple[str, ...]]  # by note: the responses that share it


def notes_of(analysis: Analysis) -> Notes:
    """Return the notes of all responses; a note on several of them is a shared one."""
    listed = {r.spec.name: tuple(dict.fromkeys(_notes(r))) for r in analysis.responses}
    names: dict[str, tuple[str, ...]] = {}
    for name, notes in listed.items():
        for note in notes:
            names[note] = (*names.get(note, ()), name)
    own = {name: tuple(note for note in notes if len(names[note]) == 1) for name, notes in listed.items()}
    return Notes(own, {note: those for note, those in names.items() if len(those) > 1})


def _notes(response: ResponseAnalysis) -> list[str]:
    """Return the notes on capability, methods, sensitivity and fits of a response."""
    found = list(response.capability.notes)
    found += [response.historical.finding] if response.historical and response.historical.finding else []
    found += [f"{METHODS[method.method]}: {note}" for method in response.methods for note in method.notes]
    found += response.sensitivity.notes if response.sensitivity else ()
    return found + list(response.fits.notes)


@cache
def environment() -> Environment:
    """Return the environment of the templates, with filters for numbers and figures."""
    # It is created once: it caches compiled templates, and compiling takes most of the time of a page.
    made = page_environment("reporting.render")
    made.globals["deciding"] = DECIDING
    made.globals["dark"] = DARK
    made.filters.update(
        fixed=format_numbers.fixed,
        z=format_numbers.z_score,
        least_ppm=least_ppm,
        largest_z=largest_z,
        share=format_numbers.part,
        p=format_numbers.probability,
        unit=unit_suffix,
        places=format_numbers.decimals_for,
        assumed=_assumed_text,
        grouped_by=lambda items, attribute: [
            (kind, list(those)) for kind, those in groupby(items, attrgetter(attribute))
        ],
        histogram=lambda r: as_markup(figures.response_figure(r)),
        probability_plot=lambda r: as_markup(figures.probability_figure(r)),
        convergence_plot=lambda r: as_markup(figures.convergence_figure(r)),
        tornado=lambda r: as_markup(figures.tornado_figure(r)),
        variable_histogram=lambda v: as_markup(figures.variable_figure(v)),
        scatter_plot=lambda s, r, unit: as_markup(figures.scatter_figure(r, s, unit)),
        slope_unit=figures.slope_unit,
        mini=lambda r: as_markup(panels.mini_histogram(r)),
        marked_words=panels.marked_words,
        control_chart=lambda r: as_markup(panels.control_chart_figure(r)),
        spread_chart=lambda r: as_markup(panels.spread_chart_figure(r)),
        deciding_plot=lambda r: as_markup(panels.deciding_probability_figure(r)),
        deciding_fit=panels.deciding_fit,
        decides=panels.decides,
        index_plot=lambda r: as_markup(panels.index_figure(r)),
        causes_plot=lambda r: as_markup(panels.causes_figure(r)),
        scatters_plot=lambda r, units: as_markup(panels.scatters_figure(r, units)),
        first_sentence=first_sentence,
        short_form=short_form,
        compared=lambda c: as_markup(figures.compared_figure(c)),
    )
    return made


def _assumed_text(value: float | tuple[float, ...] | str) -> str:
    """Return the value of an assumption as text, not rounded."""
    if isinstance(value, tuple):
        return f"({', '.join(map(format_numbers.plain, value))})"
    return value if isinstance(value, str) else format_numbers.plain(value)


def as_markup(svg: str | None) -> Markup | None:
    """Return a figure marked as safe HTML."""
    return None if svg is None else Markup(svg)


def label_cells(page: str) -> str:
    """Return the page with the name of its column added to every cell of wide tables."""
    # It reads HTML from this package's templates: user input is escaped, so every tag comes from the templates.
    return _TABLE.sub(lambda found: _labelled(found[0]), page)


def _labelled(table: str) -> str:
    """Return a table with labels; a narrow table is returned unchanged."""
    head, end, body = table.partition("</thead>")
    names = _column_names(_ROW.findall(head))
    if len(names) <= WIDE:
        return table
    rows = _ROW.sub(lambda row: _labelled_row(row[0], names), body)
    tag, _, rest = head.partition(">")
    tag = tag.replace('class="', 'class="stack ') if 'class="' in tag else f'{tag} class="stack"'
    return f"{tag}>{rest}{end}{rows}"


def _column_names(rows: list[str]) -> list[str]:
    """Return the name of each column; for a head with two rows, the name of the group and that of the column."""
    names: list[str] = []
    groups: list[tuple[int, int]] = []  # first column and number of columns of each group cell
    for cells in map(_CELL.findall, rows[:1]):
        for _, attributes, content in cells:
            span = _span(attributes)
            groups += [(len(names), span)] if span > 1 else []
            names += [_words(content)] * span
    below = [_words(content) for row in rows[1:2] for _, _, content in _CELL.findall(row)]
    places = [column for first, span in groups for column in range(first, first + span)]
    for column, name in zip(places, below, strict=False):
        names[column] = f"{names[column]} {name}"
    return names


def _labelled_row(row: str, names: list[str]) -> str:
    """Return a row whose cells have the names of their columns; the row heading gets none."""
    column = 0

    def label(cell: re.Match[str]) -> str:
        nonlocal column
        name, column = names[column] if column < len(names) else "", column + _span(cell[2])
        if cell[1] == "th" or not name:
            return cell[0]
        return f'<td{cell[2]} data-label="{name}">{cell[3]}</td>'

    return _CELL.sub(label, row)


def _span(attributes: str) -> int:
    """Return how many columns a cell spans."""
    found = re.search(r'colspan="(\d+)"', attributes)
    return int(found[1]) if found else 1


def _words(content: str) -> str:
    """Return the text of a cell, still escaped, including quotation marks, because it becomes an attribute."""
    return " ".join(_TAG.sub(" ", content).split()).replace('"', "&#34;")
