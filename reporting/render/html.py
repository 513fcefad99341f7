"""The report as one self-contained page: style and figures inline, no script, no request.

A content security policy tells the browser so: whatever got into the page, it runs no script, loads nothing and sends
nothing. Of style sheets it allows the page's own.
"""

import base64
import hashlib
from collections.abc import Iterable
from itertools import groupby
from operator import attrgetter
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from reporting import format_numbers
from reporting.analysis import Analysis
from reporting.capability.indices import NAMES, SIX_SIGMA_SHIFT, WHICH_SIGMA
from reporting.capability.shares import largest_z, least_ppm, runs_to_claim
from reporting.capability.verdict import CAPABLE, MARGINAL
from reporting.render import axes, figures, histograms, overview, scatter_figure
from reporting.render.goal_plot import goal_figure
from reporting.render.mechanism_figure import mechanism_figure
from reporting.render.narrow import label_cells
from reporting.response import CLAIM_PPM, ResponseAnalysis
from reporting.sensitivity.influence import CRITICAL_SHARE

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
CLAIMS = (1000.0, 100.0, CLAIM_PPM, 10.0, 1.0)


def render_html(analysis: Analysis, files: tuple[str, ...] = ("capability.json",), missing: str = "") -> str:
    """Return the page of an analysis, the same text for the same analysis.

    Parameters
    ----------
    analysis : Analysis
        The analysis to render.
    files : tuple of str
        Names of the files beside it.
    missing : str
        Omitted files, and how to get them.
    """
    # Figures escape their own texts and are marked as safe; the templates escape everything else.
    return label_cells(
        _environment()
        .get_template("report.html.j2")
        .render(
            a=analysis,
            weakest=weakest(analysis),
            marks=MARKS,
            methods=METHODS,
            names=NAMES,
            which_sigma=WHICH_SIGMA,
            shift=SIX_SIGMA_SHIFT,
            capable=CAPABLE,
            marginal=MARGINAL,
            critical=CRITICAL_SHARE,
            claims=[(ppm, runs_to_claim(ppm, analysis.confidence)) for ppm in CLAIMS],
            overview=_markup(overview.overview_figure(analysis)),
            goal=_markup(goal_figure(analysis)),
            one_sided=overview.one_sided(analysis),
            out_of_figures=overview.out_of_figures(analysis),
            mechanism=_markup(mechanism_figure(analysis.spec.drawing) if analysis.spec.drawing else None),
            files=files,
            missing=missing,
        )
    )


def weakest(analysis: Analysis) -> ResponseAnalysis | None:
    """Return the response with the smallest Cpk; None if no response has a meaningful one."""
    if not analysis.design.production:
        return None
    indices = [(r.capability.cpk, i) for i, r in enumerate(analysis.responses) if r.capability.cpk is not None]
    return analysis.responses[min(indices)[1]] if indices else None


def _environment() -> Environment:
    """Return the environment of the templates, with filters for numbers and figures."""
    environment = Environment(
        loader=PackageLoader("reporting.render"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(
        plain=format_numbers.plain,
        fixed=format_numbers.fixed,
        index=format_numbers.index,
        ppm=format_numbers.ppm,
        z=format_numbers.z_score,
        least_ppm=least_ppm,
        largest_z=largest_z,
        percent=format_numbers.percent,
        share=format_numbers.part,
        significant=format_numbers.significant,
        grouped=format_numbers.grouped,
        duration=format_numbers.duration,
        p=format_numbers.probability,
        unit=axes.unit_suffix,
        places=format_numbers.decimals_for,
        source_hash=_source_hash,
        assumed=_assumed_text,
        grouped_by=_grouped_by,
        histogram=lambda r: _markup(histograms.response_figure(r)),
        probability_plot=lambda r: _markup(figures.probability_figure(r)),
        convergence_plot=lambda r: _markup(figures.convergence_figure(r)),
        tornado=lambda r: _markup(figures.tornado_figure(r)),
        variable_histogram=lambda v: _markup(histograms.variable_figure(v)),
        scatter_plot=lambda s, r, unit: _markup(scatter_figure.scatter_figure(r, s, unit)),
        slope_unit=scatter_figure.slope_unit,
        compared=lambda c: _markup(histograms.compared_figure(c)),
    )
    return environment


def _grouped_by(items: Iterable[Any], attribute: str) -> list[tuple[Any, list[Any]]]:
    """Return neighbours of one kind together, in their order."""
    return [(kind, list(members)) for kind, members in groupby(items, attrgetter(attribute))]


def _assumed_text(value: float | tuple[float, ...] | str) -> str:
    """Return the value of an assumption, not rounded."""
    if isinstance(value, tuple):
        return f"({', '.join(map(format_numbers.plain, value))})"
    return value if isinstance(value, str) else format_numbers.plain(value)


def _source_hash(text: str) -> str:
    """Return the hash by which a content security policy names an element."""
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"


def _markup(svg: str | None) -> Markup | None:
    """Return a figure marked as safe HTML."""
    return None if svg is None else Markup(svg)
