"""Calls for operation: whether the server is alive, whether it is ready, and its metrics."""

import logging

from fastapi import Request
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest
from pydantic import BaseModel, Field
from starlette.responses import Response

from campaign.web.answers.engine_warm_up import EngineCompiling
from campaign.web.api.calls import calls
from campaign.web.http.asking import TheService
from campaign.web.http.problems import Refusal, described

router = calls("operation", with_login=False)
logger = logging.getLogger(__name__)


class Health(BaseModel):
    """The health of the server."""

    status: str = Field(examples=["ok"])


@router.get("/healthz")
async def healthz() -> Health:
    """Answer that the process is alive; nothing else is checked."""
    return Health(status="ok")


@router.get("/readyz", responses=described(503))
def readyz(service: TheService) -> Health:
    """Check that the store and the database can be read, and that the engine is not being compiled."""
    compiling_s = service.pool.compiling_s
    if compiling_s is not None:
        raise EngineCompiling(compiling_s)
    service.database.row("SELECT 1")
    try:
        service.store.folders()
    except Exception as error:
        logger.warning("the store cannot be read: %s", error)  # only in the log, because anybody may ask
        words = "the store cannot be read; the server's log says why"
        raise Refusal(503, words, headers={"Retry-After": "10"}) from error
    return Health(status="ok")


@router.get("/metrics", response_class=Response, responses={200: {"content": {"text/plain": {}}}})
async def metrics(request: Request) -> Response:
    """Return counts of requests, streams, jobs and campaigns, in the text format of Prometheus."""
    registry = request.app.state.metrics.registry
    return Response(generate_latest(registry), headers={"Content-Type": CONTENT_TYPE_LATEST})
