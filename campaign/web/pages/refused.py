"""The page of a refused request."""

from http import HTTPStatus
from urllib.parse import quote

from fastapi import Request
from starlette.responses import RedirectResponse, Response

from campaign.web.http.problems import Refusal
from campaign.web.pages.rendering import page


def refused_page(request: Request, refusal: Refusal) -> Response:
    """Return the page of a refusal; visitors who are not logged in are sent to the login first, and back afterwards."""
    if refusal.status == 401 and request.method == "GET":
        wanted = request.url.path + (f"?{request.url.query}" if request.url.query else "")
        return RedirectResponse(f"/login?next={quote(wanted, safe='')}", 303)
    title = HTTPStatus(refusal.status).phrase
    return page(request, "refused", refusal=refusal, title=title)
