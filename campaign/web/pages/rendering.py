"""Make a page from its template."""

from typing import Any
from urllib.parse import urlencode

from fastapi import Request
from starlette.responses import HTMLResponse

from campaign.web.access import Principal, Role
from campaign.web.http.problems import Refusal
from reporting.render.page_templates import page_environment

_templates = page_environment("campaign.web.pages")
_templates.filters["dict_query"] = lambda asked: urlencode(asked, doseq=True)


def page(
    request: Request, name: str, status: int = 200, /, *, refusal: Refusal | None = None, **values: Any
) -> HTMLResponse:
    """Return a page.

    Parameters
    ----------
    request : Request
        What it answers; the page shows who asks.
    name : str
        Name of the template, without ``.html.j2``.
    status : int
        Status of the answer.
    refusal : Refusal, optional
        What was refused, for the template; status and headers of the answer are its own.
    values
        What the template shows.
    """
    principal: Principal | None = getattr(request.state, "principal", None)
    reloads = refusal.reload_after_s if refusal and request.method == "GET" else None  # a form would be lost
    html = _templates.get_template(f"{name}.html.j2").render(
        principal=principal, Role=Role, path=request.url.path, refusal=refusal, reload_after_s=reloads, **values
    )
    return HTMLResponse(html, refusal.status, refusal.headers) if refusal else HTMLResponse(html, status)
