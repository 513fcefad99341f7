"""The FastAPI application: its routers, middleware and error handlers."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.openapi.utils import get_openapi
from fastapi.staticfiles import StaticFiles
from starlette.exceptions import HTTPException
from starlette.responses import Response

from campaign.errors import CampaignError
from campaign.row_build import clearcap_version
from clearcap.web.api import routers
from clearcap.web.http.monitoring import Metrics, Record, ServiceGauges, WorkGauges
from clearcap.web.http.problems import MEDIA_TYPE, Refusal, described, problem, problem_schemas, refusal_of
from clearcap.web.http.request_limits import RequestLimits
from clearcap.web.http.responses import Head
from clearcap.web.pages import STATIC, page_routers
from clearcap.web.pages.rendering import SITE, refused_page
from clearcap.web.settings import PREFIX
from clearcap.web.web_service import Service
from engine import EngineError

DESCRIPTION = """
Mechanisms, campaigns and their reports over HTTP. Log in as a browser does, or send a token:
`Authorization: Bearer clearcap_token_...`. Every refusal is answered with problem details (RFC 9457).
"""


def make_app(service: Service) -> FastAPI:
    """Return the FastAPI application of a service, which is closed when the application ends."""

    @asynccontextmanager
    async def life(_: FastAPI) -> AsyncIterator[None]:
        async with service.working():
            yield

    app = FastAPI(
        title="clearcap",
        summary="From clearance to capability",
        description=DESCRIPTION,
        version=clearcap_version(),
        openapi_url=f"{PREFIX}/openapi.json",
        docs_url=None,  # they load scripts from other hosts
        redoc_url=None,
        lifespan=life,
    )
    app.openapi = partial(_described, app)  # type: ignore[method-assign]  # FastAPI's own way to extend it
    app.state.service = service
    app.state.metrics = Metrics()
    app.state.metrics.registry.register(ServiceGauges(service.watcher, service.pool))
    app.state.metrics.registry.register(WorkGauges(lambda: service.workload, service.free_space))
    for router in (*routers(), *page_routers()):
        app.include_router(router)
    app.mount("/static", StaticFiles(directory=STATIC), name="static")
    if SITE.is_dir():
        app.mount("/help/documentation", StaticFiles(directory=SITE, html=True), name="documentation")
    for kind in (Refusal, CampaignError, EngineError):
        app.add_exception_handler(kind, _refuse)
    app.add_exception_handler(HTTPException, _refuse_http)
    app.add_exception_handler(RequestValidationError, _refuse_form)  # type: ignore[arg-type]  # narrower than Exception
    # A request passes the middleware added last first. RequestLimits is the outermost: it refuses foreign hosts and
    # large bodies before anything else is done for them, numbers the request for the log, and adds its headers to every
    # answer, also to the 500 of Record. Record comes before Head, so that it logs HEAD as such, and a bug in Head as
    # well.
    app.add_middleware(Head)
    app.add_middleware(Record, audit=service.audit, metrics=app.state.metrics)
    settings = service.settings
    app.add_middleware(RequestLimits, names=settings.names, limits=settings.limits, secure=not settings.is_local)
    return app


def _described(app: FastAPI) -> dict[str, Any]:
    """Return the OpenAPI 3.1 description of the API, with the schemas of refusals; it is generated once."""
    if app.openapi_schema is None:
        app.openapi_schema = get_openapi(
            title=app.title,
            version=app.version,
            summary=app.summary,
            description=app.description,
            routes=app.routes,
        )
        app.openapi_schema["components"]["schemas"].update(problem_schemas())
        for path in app.openapi_schema["paths"].values():
            for call in path.values():
                _without_frameworks_fault(call["responses"])
    return app.openapi_schema


def _without_frameworks_fault(responses: dict[str, Any]) -> None:
    """Replace FastAPI's description of the 422 answer by that of the answer that is really sent."""
    if "application/json" in responses.get("422", {}).get("content", {}):
        responses["422"] = described(422)[422]


def _refuse(request: Request, error: Exception) -> Response:
    """Answer an error that clearcap itself raised."""
    refusal = refusal_of(error)
    assert refusal is not None
    return _answer(request, refusal)


def _refuse_http(request: Request, error: Exception) -> Response:
    """Answer a request that the framework refuses, such as one with an unknown path or method."""
    assert isinstance(error, HTTPException)
    if isinstance(error.__cause__, Refusal):  # while the framework read the body
        return _answer(request, error.__cause__)
    headers = dict(error.headers or {})
    return _answer(request, Refusal(error.status_code, f"{request.url.path}: {error.detail}"[:500], headers=headers))


def _refuse_form(request: Request, error: RequestValidationError) -> Response:
    """Answer a request with invalid parameters or an invalid body."""
    faults = [
        {"keys": [str(part) for part in fault["loc"] or ["body"]], "text": fault["msg"]}
        for fault in error.errors()[:100]
    ]
    detail = "; ".join(f"{'.'.join(fault['keys'])}: {fault['text']}" for fault in faults[:5])
    return _answer(request, Refusal(422, detail, faults))


def _answer(request: Request, refusal: Refusal) -> Response:
    """Return a refusal as problem details, or as a page for a browser."""
    if not request.url.path.startswith("/api/") and "text/html" in request.headers.get("accept", ""):
        return refused_page(request, refusal)
    content = problem(refusal.status, refusal.detail, refusal.faults).model_dump_json()
    return Response(content, refusal.status, refusal.headers, MEDIA_TYPE)
