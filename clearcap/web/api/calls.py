"""The routers of the API's calls: path prefix, documentation, common refusals."""

from collections.abc import Callable, Coroutine, Iterator
from typing import Any

from fastapi import APIRouter, Request
from fastapi.dependencies.models import Dependant
from fastapi.routing import APIRoute
from starlette.responses import Response

from clearcap.web.http.authentication import FORMS, SAFE_METHODS, WHO_MAY, principal_of, who_may
from clearcap.web.http.problems import described
from clearcap.web.http.request_limits import check_values
from clearcap.web.settings import PREFIX


class _Call(APIRoute):
    """A call whose summary is the first line of its docstring; its documentation also says who may use it."""

    def __init__(self, path: str, endpoint: Callable[..., Any], **options: Any) -> None:
        if not options.get("summary"):
            options["summary"] = (endpoint.__doc__ or "").strip().split("\n")[0].rstrip(".")
        super().__init__(path, endpoint, **options)
        self.openapi_extra = {**(self.openapi_extra or {}), WHO_MAY: who_may(_all_of(self.dependant))}

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """Return the handler of a request, which refuses strangers before the body is read, and JSON of many values."""
        handle = super().get_route_handler()

        async def handle_known(request: Request) -> Response:
            if request.method not in SAFE_METHODS:
                principal_of(request)
                if not request.headers.get("content-type", "").startswith(FORMS):
                    check_values(await request.body())
            return await handle(request)

        return handle_known


def _all_of(dependant: Dependant) -> Iterator[object]:
    """Yield the functions that a call depends on."""
    for each in dependant.dependencies:
        yield each.call
        yield from _all_of(each)


def _router(tag: str) -> APIRouter:
    """Return a router for the calls of one kind, which the documentation shows under `tag`.

    All but those of operation need a login; they have the path prefix and the common refusals.
    """
    is_open = tag == "operation"
    refusals = {} if is_open else described(400, 401, 403, 413, 422, 429, 500, 503)
    return APIRouter(prefix="" if is_open else PREFIX, tags=[tag], route_class=_Call, responses=refusals)


_TAGS = ("operation", "mechanisms", "simulations", "campaigns", "reports", "questions", "samples", "users", "account")
ROUTERS = {tag: _router(tag) for tag in (*_TAGS, "tokens", "audit", "shares", "sign-off", "webhooks")}
