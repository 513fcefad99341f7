"""The page as PDF, from the same template; the style sheet has rules for paper."""

import logging

from reporting.errors import ReportError


def render_pdf(page: str) -> bytes:
    """Return the page, HTML of `reporting.render.html.render_html`, as PDF on A4, without any request.

    ReportError: the libraries that WeasyPrint needs are not installed.
    """
    try:
        from weasyprint import HTML
    except OSError as error:
        raise ReportError(
            f"report.pdf: WeasyPrint finds no Pango ({error}); install it (Debian: libpango-1.0-0 libpangoft2-1.0-0)"
            " or leave the PDF out"
        ) from error
    # WeasyPrint logs every rule of the style sheet that applies to screens only.
    logging.getLogger("weasyprint").setLevel(logging.ERROR)
    content: bytes = HTML(string=page, url_fetcher=_refuse).write_pdf()
    return content


def _refuse(url: str, *_: object, **__: object) -> dict[str, object]:
    """Refuse every request, because the page is self-contained."""
    raise ReportError(f"the page refers to {url[:80]}, but a report must not load anything from outside")
