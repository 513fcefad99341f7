"""Calls that answer with a file, a picture, a table or a stream, with their ETag; and those of monitoring."""

import json
import logging
from collections.abc import AsyncIterator, Iterator
from typing import Annotated, Any

from fastapi import Path, Query, Request
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest
from pydantic import BaseModel, Field
from starlette.concurrency import iterate_in_threadpool, run_in_threadpool
from starlette.responses import Response, StreamingResponse

from campaign.store.layout import CAMPAIGN_FILE
from campaign.store.mechanism_library import read_mechanism
from campaign.store.store import report_folder
from clearcap.questions.exported_rows import FORMATS, RowSelection, export_rows, rows_etag
from clearcap.questions.mechanisms import (
    animate_once,
    draw_mechanism,
    values_of,
)
from clearcap.questions.samples import (
    SamplePage,
    draw_sample,
    sample_motion,
)
from clearcap.web.access import Principal
from clearcap.web.answers.engine_warm_up import EngineCompiling
from clearcap.web.api.calls import ROUTERS
from clearcap.web.http.authentication import (
    Authenticated,
    Engineer,
    OtherCampaign,
    TheCampaign,
    TheService,
    Viewer,
)
from clearcap.web.http.problems import Refusal, described, sendable
from clearcap.web.http.responses import ETAG_STATUSES, EventStream, document, etag_response
from clearcap.web.operations.campaign_list import (
    LONGEST_CURSOR,
    MOST_LISTED,
    Listing,
    ListQuestion,
    after_cursor,
    cursor_after,
    listed,
)
from clearcap.web.operations.campaigns import FILE_NAME
from clearcap.web.operations.mechanisms import MOST_VALUES, MechanismName, shipped_text, source_of
from clearcap.web.operations.samples import ENDINGS, RowsQuestion, Sample, SampleQuestion, drawn
from clearcap.web.web_service import Service
from engine.mechanism import library_names

_EVENT = {  # OpenAPI schema of an event in a stream
    "type": "object",
    "properties": {"event": {"enum": ["progress", "end"]}, "id": {"type": "string"}, "data": {"type": "string"}},
}


@ROUTERS["campaigns"].get("/campaigns", response_model=Listing, responses=described(*ETAG_STATUSES))
async def list_campaigns(
    request: Request,
    service: TheService,
    _: Viewer,
    question: Annotated[ListQuestion, Query()],
    cursor: Annotated[str, Query(max_length=LONGEST_CURSOR, description="From the page before")] = "",
    limit: Annotated[int, Query(ge=1, le=MOST_LISTED)] = 100,
) -> Response:
    """List campaigns: state, progress, yield, weakest Cpk, owner and tags."""
    await service.watcher.list_first()
    found = listed(service.watcher.index.entries(), question)
    rest = after_cursor(found, question.sort, cursor)
    page = rest[:limit]
    following = f'"{cursor_after(page[-1][0], question.sort)}"' if len(rest) > limit else "null"
    rows, unread, fault = b",".join(text for _, text in page), service.watcher.index.unread, service.store_fault
    body = b'{"campaigns":[%b],"total":%d,"next":%b,"unread":%d,"fault":%b}' % (
        rows, len(found), following.encode(), unread, json.dumps(sendable(fault)).encode()
    )  # fmt: skip
    return etag_response(request, body, "application/json")


@ROUTERS["campaigns"].get(
    "/campaigns/{campaign}/events",
    response_class=StreamingResponse,
    responses={200: {"content": {"text/event-stream": {"schema": _EVENT}}}, **described(404)},
)
async def follow_campaign(request: Request, service: TheService, campaign: TheCampaign, who: Authenticated) -> Response:
    """Follow a campaign by server-sent events: progress, rate, failures by status, each Cpk with its interval.

    Each `progress` event holds the whole state, so only the latest counts; with `Last-Event-ID`, that event is not sent
    again. `end` is the last event.
    """
    limit = service.settings.limits.streams
    if service.streams[who.name] >= limit:
        raise Refusal(429, f"{who.name} has {limit} event streams open; close one", headers={"Retry-After": "5"})
    events = service.watcher.follow(campaign, request.headers.get("last-event-id", "")[:64])
    return EventStream(request, events, service.streams, who.name)


@ROUTERS["campaigns"].get("/campaigns/{campaign}/campaign.toml", **document("application/toml", refused=(404,)))
async def campaign_file(request: Request, service: TheService, campaign: TheCampaign) -> Response:
    """Return the campaign file as it was submitted."""
    try:
        content = await run_in_threadpool(service.store.files.read, f"{campaign}/{CAMPAIGN_FILE}")
    except FileNotFoundError as error:
        raise Refusal(404, f"{campaign}: has no {CAMPAIGN_FILE} any more; restore it in the store") from error
    return etag_response(request, content, "application/toml")


TYPES = {
    "html": "text/html; charset=utf-8",
    "json": "application/json",
    "parquet": "application/vnd.apache.parquet",
    "pdf": "application/pdf",
    "xlsx": "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet",
    "svg": "image/svg+xml",
    "png": "image/png",
}
# policy of a report's page: it runs nothing, loads nothing, and only this server's pages show it in a frame
REPORT_POLICY = (
    "sandbox allow-popups; default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none';"
    " form-action 'none'; frame-ancestors 'self'"
)
FileName = Annotated[str, Path(pattern=FILE_NAME, examples=["report.html"])]
_FILE = document(*TYPES.values(), "application/octet-stream", refused=(404,), schema={})


@ROUTERS["reports"].get("/campaigns/{campaign}/reports/own/{name}", **_FILE)
async def report_file(request: Request, service: TheService, campaign: TheCampaign, name: FileName) -> Response:
    """Return a file of a campaign's report, whole or in parts."""
    return await _file(request, service, report_folder(campaign), name)


@ROUTERS["reports"].get("/campaigns/{campaign}/reports/against/{other}/{name}", **_FILE)
async def comparison_file(
    request: Request,
    service: TheService,
    campaign: TheCampaign,
    who: Authenticated,
    other: OtherCampaign,
    name: FileName,
) -> Response:
    """Return a file of a comparison, whole or in parts, to users who may see both campaigns."""
    if not who.may_see(other):
        raise Refusal(404, f"no campaign {other} in the store")
    return await _file(request, service, report_folder(campaign, other), name)


async def _file(request: Request, service: Service, folder: str, name: str) -> Response:
    """Return a file of a report."""
    kind = TYPES.get(name.rpartition(".")[2], "application/octet-stream")
    try:
        content = await run_in_threadpool(service.store.files.read, f"{folder}/{name}")
    except FileNotFoundError as error:
        raise Refusal(404, f"{folder}: has no file {name}; write the report first") from error
    frame = {"Content-Security-Policy": REPORT_POLICY, "X-Frame-Options": "SAMEORIGIN"}
    return etag_response(request, content, kind, frame)


_ROWS: dict[int | str, dict[str, Any]] = {
    200: {"content": {kind.partition(";")[0]: {"schema": {"type": "string"}} for kind in FORMATS.values()}}
}
MOTION = {  # see `clearcap.pictures.moving_drawing`
    "type": "object",
    "properties": {
        "width": {"type": "number"},
        "height": {"type": "number"},
        "unit": {"type": "string", "description": "Of time"},
        "bodies": {"type": "array", "items": {"type": "object"}, "description": "As they are drawn at the end"},
        "frames": {"type": "object", "description": "`time`; of each body its polylines, and its place in each frame"},
    },
    "required": ["width", "height", "unit", "bodies", "frames"],
}


@ROUTERS["samples"].get(
    "/campaigns/{campaign}/rows", response_class=StreamingResponse, responses={**_ROWS, **described(304, 404, 409)}
)
async def export(
    request: Request,
    service: TheService,
    campaign: TheCampaign,
    who: Authenticated,
    question: Annotated[RowsQuestion, Query()],
) -> Response:
    """Return rows as Arrow (a stream of batches), Parquet or CSV, in the order of the samples.

    Arrow and Parquet have units in the metadata of the columns. The file is generated while it is sent. The answer is
    304 if `If-None-Match` has the ETag of the rows.
    """
    kind = question.format
    selection = RowSelection(tuple(question.columns), question.first, question.last, tuple(question.status))
    tag = rows_etag(await service.answers.version(campaign), kind, selection)
    headers = {"ETag": tag, "Cache-Control": "private, no-cache"}
    if tag in [word.strip().removeprefix("W/") for word in request.headers.get("if-none-match", "").split(",")]:
        return Response(status_code=304, headers=headers)
    store = service.store
    plan = await run_in_threadpool(store.plan, campaign)
    pieces = await run_in_threadpool(export_rows, store, plan, kind, selection)
    headers["Content-Disposition"] = f'attachment; filename="{campaign}.{ENDINGS[kind]}"'
    return StreamingResponse(_sent(service, who, pieces), media_type=FORMATS[kind], headers=headers)


def _sent(service: Service, who: Principal, pieces: Iterator[bytes]) -> AsyncIterator[bytes]:
    """Return the pieces of a file; while it is sent, it counts as one of the user's streams."""
    limit = service.settings.limits.streams
    if service.streams[who.name] >= limit:
        raise Refusal(429, f"{who.name} has {limit} streams open; close one", headers={"Retry-After": "5"})

    async def sent() -> AsyncIterator[bytes]:
        service.streams[who.name] += 1
        try:
            async for piece in iterate_in_threadpool(pieces):
                yield piece
        finally:
            service.streams[who.name] -= 1

    return sent()


@ROUTERS["samples"].get(
    "/campaigns/{campaign}/samples", responses=described(*ETAG_STATUSES, 404, 409), response_model=SamplePage
)
async def list_samples(
    request: Request,
    service: TheService,
    campaign: TheCampaign,
    who: Authenticated,
    question: Annotated[SampleQuestion, Query()],
) -> Response:
    """List samples, by default with the smallest distance of a response from its limit first."""
    asked = (question.sort, question.status or None, question.cursor, question.limit)
    return etag_response(
        request, (await service.answers.samples(who.name, campaign, *asked)).content, "application/json"
    )


@ROUTERS["samples"].get("/campaigns/{campaign}/samples/{sample}/plot.svg", **document("image/svg+xml"))
async def plot(request: Request, service: TheService, campaign: TheCampaign, who: Viewer, sample: Sample) -> Response:
    """Compute a sample again and draw its curves over time."""
    content = await drawn(service, campaign, who, sample, draw_sample, "svg")
    return etag_response(request, content, "image/svg+xml")


@ROUTERS["samples"].get("/campaigns/{campaign}/samples/{sample}/motion.gif", name="motion", **document("image/gif"))
async def motion_gif(
    request: Request, service: TheService, campaign: TheCampaign, who: Viewer, sample: Sample
) -> Response:
    """Compute a sample again and draw its motion."""
    content = await drawn(service, campaign, who, sample, draw_sample, "gif")
    return etag_response(request, content, "image/gif")


@ROUTERS["samples"].get(
    "/campaigns/{campaign}/samples/{sample}/motion.json", **document("application/json", schema=MOTION)
)
async def motion_data(
    request: Request, service: TheService, campaign: TheCampaign, who: Viewer, sample: Sample
) -> Response:
    """Compute a sample again and return its motion as data: outlines of the bodies and their places over time."""
    return etag_response(request, await drawn(service, campaign, who, sample, sample_motion), "application/json")


@ROUTERS["mechanisms"].get("/mechanisms/{name}/text", **document("application/toml", refused=(404,)))
async def mechanism_text(
    request: Request,
    service: TheService,
    _: Viewer,
    name: MechanismName,
    version: Annotated[int | None, Query(ge=1, lt=10**6, description="By default the newest")] = None,
) -> Response:
    """Return the text of a mechanism's file."""
    if name in library_names() and version is None:
        return etag_response(request, shipped_text(name), "application/toml")
    saved = await run_in_threadpool(read_mechanism, service.store, name, version)
    if saved is None:
        raise Refusal(404, f"no mechanism {name}{'' if version is None else f' of version {version}'}")
    headers = {"X-Version": str(saved.version)}
    return etag_response(request, saved.text.encode(), "application/toml", headers)


@ROUTERS["mechanisms"].get("/mechanisms/{name}/picture.svg", **document("image/svg+xml"))
async def mechanism_picture(
    request: Request,
    service: TheService,
    who: Viewer,
    name: MechanismName,
    bench: Annotated[str | None, Query(max_length=100)] = None,
) -> Response:
    """Draw a mechanism at its start, with what its responses measure."""
    source = await source_of(service, name, bench=bench)
    return etag_response(request, await service.kept(who.name, draw_mechanism, source), "image/svg+xml")


@ROUTERS["simulations"].get("/simulations/{name}/motion.gif", **document("image/gif"))
async def motion(
    request: Request,
    service: TheService,
    who: Engineer,
    name: MechanismName,
    set: Annotated[list[str] | None, Query(max_length=MOST_VALUES, description="KEY=VALUE")] = None,
    bench: Annotated[str | None, Query(max_length=100)] = None,
    preset: Annotated[str | None, Query(max_length=100)] = None,
) -> Response:
    """Simulate a mechanism and draw its motion."""
    source = await source_of(service, name, bench=bench, preset=preset, values=values_of(set or []))
    return etag_response(request, await service.kept(who.name, animate_once, source), "image/gif")


@ROUTERS["sign-off"].get(
    "/campaigns/{campaign}/signoffs/export.zip",
    response_class=Response,
    responses={
        200: {"content": {"application/zip": {"schema": {"type": "string", "format": "binary"}}}},
        **described(404, 409),
    },
)
def export_signed(service: TheService, campaign: TheCampaign, _: Authenticated) -> StreamingResponse:
    """Export a campaign with its sign-offs as a ZIP file, which `clearcap verify` verifies without the server."""
    if not service.signing_service.has_documents(campaign):
        raise Refusal(409, f"nobody has signed {campaign}; it can be exported once an approver has signed it")
    headers = {"Content-Disposition": f'attachment; filename="{campaign}.zip"'}
    return StreamingResponse(service.signing_service.export(campaign), media_type="application/zip", headers=headers)


logger = logging.getLogger(__name__)


class Health(BaseModel):
    """The health of the server."""

    status: str = Field(examples=["ok"])


@ROUTERS["operation"].get("/healthz")
async def healthz() -> Health:
    """Answer that the process is alive; nothing else is checked."""
    return Health(status="ok")


@ROUTERS["operation"].get("/readyz", responses=described(503))
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


@ROUTERS["operation"].get(
    "/metrics", response_class=Response, responses={200: {"content": {"text/plain": {}}}, **described(401, 403)}
)
async def metrics(request: Request, service: TheService, _: Viewer) -> Response:
    """Return counts of requests, jobs, campaigns and workers, without names, in the text format of Prometheus."""
    await service.look_at_work()
    registry = request.app.state.metrics.registry
    return Response(generate_latest(registry), headers={"Content-Type": CONTENT_TYPE_LATEST})
