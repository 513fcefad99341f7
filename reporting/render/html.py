"""The report as one self-contained page with inline style and figures, without scripts and requests.

A content security policy enforces this in the browser: the page runs no script, loads nothing and sends nothing. The
only style sheet it allows is the page's own.
"""

from reporting.analysis import Analysis
from reporting.capability.indices import NAMES, SIX_SIGMA_SHIFT, WHICH_SIGMA
from reporting.capability.shares import runs_to_claim
from reporting.capability.verdict import CAPABLE, MARGINAL
from reporting.render import overview
from reporting.render.goal_plot import goal_figure
from reporting.render.mechanism_figure import mechanism_figure
from reporting.render.narrow import label_cells
from reporting.render.templating import as_markup, environment
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

    `files` are the names of the files next to the page; `missing` names omitted files, and how to get them.
    """
    # Figures escape their own texts and are marked as safe; the templates escape everything else.
    return label_cells(
        environment()
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
            overview=as_markup(overview.overview_figure(analysis)),
            goal=as_markup(goal_figure(analysis)),
            one_sided=overview.one_sided(analysis),
            out_of_figures=overview.out_of_figures(analysis),
            mechanism=as_markup(mechanism_figure(analysis.spec.drawing) if analysis.spec.drawing else None),
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
