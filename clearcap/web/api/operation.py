"""Calls for operation: whether the server is alive and ready, its metrics, and its audit trail."""

import logging
from datetime import UTC, datetime
from typing import Annotated

from fastapi import Query, Request
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest
from pydantic import BaseModel, Field
from starlette.responses import Response

from clearcap.web.access.audit import Entry
from clearcap.web.answers.engine_warm_up import EngineCompiling
from clearcap.web.api.calls import calls
from clearcap.web.http.authentication import Admin, TheService
from clearcap.web.http.problems import Refusal, described

health_router = calls("operation", with_login=False)
logger = logging.getLogger(__name__)
audit_router = calls("audit")


class Health(BaseModel):
    """The health of the server."""

    status: str = Field(examples=["ok"])


@health_router.get("/healthz")
async def healthz() -> Health:
    """Answer that the process is alive; nothing else is checked."""
    return Health(status="ok")


@health_router.get("/readyz", responses=described(503))
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


@health_router.get("/metrics", response_class=Response, responses={200: {"content": {"text/plain": {}}}})
async def metrics(request: Request) -> Response:
    """Return counts of requests, streams, jobs and campaigns, in the text format of Prometheus."""
    registry = request.app.state.metrics.registry
    return Response(generate_latest(registry), headers={"Content-Type": CONTENT_TYPE_LATEST})


class ListedEntry(BaseModel):
    """An entry of the audit trail."""

    number: int = Field(examples=[1])
    time: datetime = Field(examples=["2026-11-23T09:00:00Z"])
    who: str = Field(examples=["eva"])
    how: str = Field(description="session, token, share, password, link, company or none", examples=["session"])
    address: str = Field(examples=["127.0.0.1"])
    action: str = Field(examples=["POST /api/v1/tokens"])
    object: str = Field(examples=["c60-0a1b2c3d4e"])
    status: int = Field(description="Status of the answer: below 400 the request was carried out", examples=[201])
    detail: str = Field(examples=["token 1, engineer, 90 days"])
    digest: str = Field(description="SHA-256 of the digest before and all fields above", examples=["0f" * 32])

    @classmethod
    def of(cls, entry: Entry) -> "ListedEntry":
        """Return the listed form of an entry."""
        return cls.model_validate({**vars(entry), "time": datetime.fromtimestamp(entry.time, UTC)})


class EntryList(BaseModel):
    """A page of the audit trail, newest first."""

    entries: list[ListedEntry]
    next: int | None = Field(description="Cursor of the next page; null on the last one", examples=[None])


class Wholeness(BaseModel):
    """Whether the audit trail is intact."""

    whole: bool = Field(examples=[True])
    first_fault: int | None = Field(description="First entry that was changed, or is missing", examples=[None])


@audit_router.get("/audit")
def list_audit(
    service: TheService,
    _: Admin,
    object: Annotated[str | None, Query(max_length=200, description="Of this campaign, user or token")] = None,
    who: Annotated[str | None, Query(max_length=100, description="Of this user")] = None,
    cursor: Annotated[int | None, Query(ge=0, le=2**53, description="From the page before")] = None,
    limit: Annotated[int, Query(ge=1, le=1000)] = 100,
) -> EntryList:
    """List who did what and when, newest first."""
    entries = service.audit.newest(cursor, object or None, who or None, limit + 1)
    following = entries[limit - 1].number if len(entries) > limit else None
    return EntryList(entries=[ListedEntry.of(entry) for entry in entries[:limit]], next=following)


@audit_router.get("/audit/check")
def check_audit(service: TheService, _: Admin) -> Wholeness:
    """Check that no entry of the audit trail was changed or removed."""
    fault = service.audit.first_fault()
    return Wholeness(whole=fault is None, first_fault=fault)
