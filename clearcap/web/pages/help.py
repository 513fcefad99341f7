"""The help page: what the service does, and every call of its API, from the OpenAPI document."""

from typing import Any

from fastapi import APIRouter, Request
from starlette.responses import Response

from clearcap.web.http.authentication import WHO_MAY, known
from clearcap.web.http.problems import Refusal
from clearcap.web.pages.rendering import page
from clearcap.web.settings import PREFIX

router = APIRouter(include_in_schema=False)
METHODS = ("get", "post", "put", "patch", "delete")


@router.get("/help")
def help_page(request: Request) -> Response:
    """Show what the service does, even to visitors who are not logged in."""
    try:
        request.state.principal = known(request)
    except Refusal:
        request.state.principal = None
    return page(
        request,
        "help",
        kinds=calls_by_kind(request.app.openapi()),
        document=f"{PREFIX}/openapi.json",
        address=request.app.state.service.settings.address,
    )


def calls_by_kind(document: dict[str, Any]) -> dict[str, list[dict[str, str]]]:
    """Return the calls of an OpenAPI document by kind, each with ``method``, ``path``, ``summary`` and ``who``."""
    kinds: dict[str, list[dict[str, str]]] = {}
    for path, methods in document["paths"].items():
        for method in METHODS:
            if method in methods:
                call = methods[method]
                shown = {"method": method.upper(), "path": path, "summary": call["summary"], "who": call[WHO_MAY]}
                kinds.setdefault(call["tags"][0], []).append(shown)
    return kinds
