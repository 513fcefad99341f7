"""The report as one self-contained page: style and figures inline, no script, no request."""

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from reporting import figures, numbers
from reporting.analysis import CAPABLE, MARGINAL, Analysis, ResponseAnalysis

MARKS = {
    "capable": "✓",
    "marginal": "!",
    "not capable": "✗",
    "no verdict": "?",
    "no limits": "–",
    "good": "✓",
    "attention": "!",
    "bad": "✗",
    "info": "i",
}


def render_html(analysis: Analysis) -> str:
    """Return the page of an analysis, the same text for the same analysis.

    Parameters
    ----------
    analysis : Analysis
        What the page says.
    """
    environment = Environment(
        loader=PackageLoader("reporting"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(
        plain=numbers.plain,
        fixed=numbers.fixed,
        index=numbers.index,
        ppm=numbers.ppm,
        percent=numbers.percent,
        significant=numbers.significant,
        grouped=numbers.grouped,
        unit=figures.unit_suffix,
        places=numbers.decimals_for,
    )
    overview = figures.overview_figure(analysis)
    # Markup: figures escape what they write themselves; everything else is escaped by the template.
    return environment.get_template("report.html.j2").render(
        a=analysis,
        headline=headline(analysis),
        weakest=weakest(analysis),
        marks=MARKS,
        capable=CAPABLE,
        marginal=MARGINAL,
        overview=Markup(overview) if overview else None,
        response_figures=[Markup(figures.response_figure(r)) for r in analysis.responses],
        variable_figures=[Markup(figures.variable_figure(v)) for v in analysis.variables],
    )


def headline(analysis: Analysis) -> str:
    """Return the outcome in one sentence."""
    limited = [r for r in analysis.responses if r.verdict != "no limits"]
    corners = [r.worst for r in limited if r.worst is not None]
    if corners and analysis.ok:
        kept = sum(bool(worst.within) for worst in corners)
        return f"Worst case: {kept} of {len(corners)} responses with limits keep them at every corner."
    if analysis.ok == 0:
        return "No sample ended ok: there is nothing to judge."
    if not limited:
        return "No response has limits: there is nothing to judge."
    capable = sum(r.verdict == "capable" for r in limited)
    if capable == len(limited):
        return f"Every response with limits is capable ({capable} of {capable})."
    return f"{capable} of {len(limited)} responses with limits are capable."


def weakest(analysis: Analysis) -> ResponseAnalysis | None:
    """Return the response with the smallest Cpk; None if none has one."""
    known = [(r.capability.cpk, i) for i, r in enumerate(analysis.responses) if r.capability.cpk is not None]
    return analysis.responses[min(known)[1]] if known else None
