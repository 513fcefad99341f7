"""Calls for the samples of a campaign: their rows as a file, a list, each stored row, its replay and its pictures."""

from collections.abc import AsyncIterator, Iterator
from typing import Annotated, Any

from fastapi import Path, Query, Request
from pydantic import BaseModel, Field
from starlette.concurrency import iterate_in_threadpool, run_in_threadpool
from starlette.responses import Response, StreamingResponse

from clearcap.questions.exported_rows import FORMATS, RowSelection, export_rows, rows_etag
from clearcap.questions.samples import (
    ReplayedSample,
    SamplePage,
    StoredSample,
    draw_sample,
    plan_with,
    replay_document,
    sample_motion,
    stored_sample,
)
from clearcap.web.access import Principal
from clearcap.web.api.calls import TheCampaign, calls
from clearcap.web.http.authentication import Asking, TheService, Viewer
from clearcap.web.http.problems import Refusal, described
from clearcap.web.http.responses import TAGGED, tagged
from clearcap.web.web_service import Service

MOST_COLUMNS = 1000
ENDINGS = {"arrow": "arrows", "parquet": "parquet", "csv": "csv"}  # a stream of Arrow batches has the ending arrows
_FILE: dict[int | str, dict[str, Any]] = {
    200: {"content": {kind.partition(";")[0]: {"schema": {"type": "string"}} for kind in FORMATS.values()}}
}
router = calls("samples")
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
ON_A_PAGE, MOST_ON_A_PAGE = 50, 1000
Sample = Annotated[int, Path(ge=0, lt=2**53, description="Number of the sample", examples=[7])]


class RowsQuestion(BaseModel):
    """The format, rows and columns of an export."""

    format: str = Field("arrow", pattern="^(arrow|parquet|csv)$", examples=["parquet"])
    columns: list[str] = Field([], max_length=MOST_COLUMNS, description="Columns, in this order; all if absent")
    first: int | None = Field(None, ge=0, lt=2**53, description="Least sample", examples=[0])
    last: int | None = Field(None, ge=0, lt=2**53, description="Largest sample", examples=[999])
    status: list[str] = Field([], max_length=20, description="Statuses of runs; all if absent", examples=[["ok"]])


@router.get(
    "/campaigns/{campaign}/rows", response_class=StreamingResponse, responses={**_FILE, **described(304, 404, 409)}
)
async def export(
    request: Request,
    service: TheService,
    campaign: TheCampaign,
    who: Asking,
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


class SampleQuestion(BaseModel):
    """The filter, order and page of a list of samples."""

    sort: str = Field("margin", pattern="^(margin|sample)$", description="`margin`: the worst first")
    status: str | None = Field(None, max_length=40, description="`ok`, `failed` or one failed status", examples=["ok"])
    cursor: int = Field(0, ge=0, le=10**9, description="From the page before")
    limit: int = Field(ON_A_PAGE, ge=1, le=MOST_ON_A_PAGE)


@router.get("/campaigns/{campaign}/samples", responses=described(*TAGGED, 404, 409), response_model=SamplePage)
async def list_samples(
    request: Request,
    service: TheService,
    campaign: TheCampaign,
    who: Asking,
    question: Annotated[SampleQuestion, Query()],
) -> Response:
    """List samples, by default with the smallest distance of a response from its limit first."""
    asked = (question.sort, question.status or None, question.cursor, question.limit)
    return tagged(request, (await service.answers.samples(who.name, campaign, *asked)).content, "application/json")


@router.get("/campaigns/{campaign}/samples/{sample}", responses=described(404))
def show_sample(service: TheService, campaign: TheCampaign, sample: Sample) -> StoredSample:
    """Show a sample: its variables, its responses, and its certificate."""
    found = stored_sample(service.store, campaign, sample)
    if found is None:
        raise Refusal(404, f"sample {sample} of {campaign}: not computed yet, or its part is broken")
    return found


@router.post("/campaigns/{campaign}/samples/{sample}/replay", responses=described(404, 409))
async def replay(service: TheService, campaign: TheCampaign, who: Viewer, sample: Sample) -> ReplayedSample:
    """Compute a sample again and compare it bit for bit with its row; return the document of `clearcap replay`."""
    store = service.store
    await run_in_threadpool(plan_with, store, campaign, sample)
    content = await service.pool.data(who.name, replay_document, store.files.full_url, campaign, sample)
    return ReplayedSample.model_validate(content)


@router.get(
    "/campaigns/{campaign}/samples/{sample}/plot.svg",
    response_class=Response,
    responses={200: {"content": {"image/svg+xml": {"schema": {"type": "string"}}}}, **described(*TAGGED, 404, 409)},
)
async def plot(request: Request, service: TheService, campaign: TheCampaign, who: Viewer, sample: Sample) -> Response:
    """Compute a sample again and draw its curves over time."""
    store = service.store
    await run_in_threadpool(plan_with, store, campaign, sample)
    content = await service.kept(who.name, draw_sample, store.files.full_url, campaign, sample, "svg")
    return tagged(request, content, "image/svg+xml")


@router.get(
    "/campaigns/{campaign}/samples/{sample}/motion.gif",
    response_class=Response,
    responses={200: {"content": {"image/gif": {"schema": {"type": "string"}}}}, **described(*TAGGED, 404, 409)},
)
async def motion(request: Request, service: TheService, campaign: TheCampaign, who: Viewer, sample: Sample) -> Response:
    """Compute a sample again and draw its motion."""
    store = service.store
    await run_in_threadpool(plan_with, store, campaign, sample)
    content = await service.kept(who.name, draw_sample, store.files.full_url, campaign, sample, "gif")
    return tagged(request, content, "image/gif")


@router.get(
    "/campaigns/{campaign}/samples/{sample}/motion.json",
    response_class=Response,
    responses={200: {"content": {"application/json": {"schema": MOTION}}}, **described(*TAGGED, 404, 409)},
)
async def motion_data(
    request: Request, service: TheService, campaign: TheCampaign, who: Viewer, sample: Sample
) -> Response:
    """Compute a sample again and return its motion as data: outlines of the bodies and their places over time."""
    return tagged(request, await motion_of(service, campaign, who, sample), "application/json")


async def motion_of(service: Service, campaign: str, who: Principal, sample: int) -> bytes:
    """Return the motion of a sample, a `clearcap.pictures.moving_drawing.MovingDrawing`, as JSON."""
    store = service.store
    await run_in_threadpool(plan_with, store, campaign, sample)
    return await service.kept(who.name, sample_motion, store.files.full_url, campaign, sample)  # type: ignore[arg-type]
