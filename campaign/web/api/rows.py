"""The call that exports the rows of a campaign as a file, which is generated while it is sent."""

from collections.abc import AsyncIterator, Iterator
from typing import Annotated, Any

from fastapi import Query, Request
from pydantic import BaseModel, Field
from starlette.concurrency import iterate_in_threadpool, run_in_threadpool
from starlette.responses import Response, StreamingResponse

from campaign.web.access import Principal
from campaign.web.answers.exported_rows import FORMATS, RowSelection, export_rows, rows_etag
from campaign.web.api.calls import calls
from campaign.web.api.whose import TheCampaign
from campaign.web.http.asking import Asking, TheService
from campaign.web.http.problems import Refusal, described
from campaign.web.web_service import Service

router = calls("samples")
MOST_COLUMNS = 1000
ENDINGS = {"arrow": "arrows", "parquet": "parquet", "csv": "csv"}  # a stream of Arrow batches has the ending arrows
_FILE: dict[int | str, dict[str, Any]] = {
    200: {"content": {kind.partition(";")[0]: {"schema": {"type": "string"}} for kind in FORMATS.values()}}
}


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
