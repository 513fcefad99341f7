"""Rendering of pages from their templates."""

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
    """Return a page from the template `name`, given without ``.html.j2``.

    If the template shows a refusal, the answer has its status and headers.
    """
    principal: Principal | None = getattr(request.state, "principal", None)
    reloads = refusal.reload_after_s if refusal and request.method == "GET" else None  # a form would be lost
    html = _templates.get_template(f"{name}.html.j2").render(
        principal=principal, Role=Role, path=request.url.path, refusal=refusal, reload_after_s=reloads, **values
    )
    return HTMLResponse(html, refusal.status, refusal.headers) if refusal else HTMLResponse(html, status)
