"""The pages of measured parts: a list with the form that sends some, and the report of each."""

from datetime import UTC, datetime
from urllib.parse import quote

from fastapi import APIRouter, Request, UploadFile
from starlette.concurrency import run_in_threadpool
from starlette.responses import RedirectResponse, Response

from campaign.errors import CampaignError
from clearcap.web.http.authentication import Engineer, TheService, Viewer
from clearcap.web.http.responses import Refusal, refusal_of
from clearcap.web.operations import measured as operations
from clearcap.web.operations.measured import PartsCursor, PartsName
from clearcap.web.pages.rendering import page
from clearcap.web.web_service import Service

router = APIRouter(include_in_schema=False)


@router.get("/measured")
async def measured_page(request: Request, service: TheService, who: Viewer, cursor: PartsCursor = None) -> Response:
    """Show the measured parts that were sent."""
    return await _list(request, service, who, cursor)


@router.post("/measured")
async def upload_form(
    request: Request, service: TheService, who: Engineer, file: UploadFile, limits: UploadFile
) -> Response:
    """Make the report of measured parts, and show it."""
    try:
        made = await operations.upload_parts(service, who, Response(), file, limits)
    except (CampaignError, Refusal) as error:
        refusal = refusal_of(error)
        assert refusal is not None
        return await _list(request, service, who, None, refusal)
    return RedirectResponse(f"/measured/{quote(made.id)}", 303)


async def _list(
    request: Request, service: Service, who: Viewer, cursor: str | None, refusal: Refusal | None = None
) -> Response:
    """Return the page of the list, with the refusal of what was sent."""
    found = await run_in_threadpool(operations.list_parts, service, who, cursor)
    rows = [(each, datetime.fromtimestamp(each.at, UTC)) for each in found.measured]
    return page(request, "measured", refusal=refusal, rows=rows, found=found, cursor=cursor)


@router.get("/measured/{measured}")
async def parts_page(request: Request, service: TheService, who: Viewer, measured: PartsName) -> Response:
    """Show the report of measured parts in a frame, and their files."""
    found = await operations.show_parts(service, who, measured)
    files = await run_in_threadpool(operations.files_of_parts, service, measured)
    at = datetime.fromtimestamp(found.at, UTC)
    return page(
        request, "measured_parts", parts=found, at=at, files=files, may_delete=operations.may_delete(found, who)
    )


@router.post("/measured/{measured}/delete")
async def delete_form(service: TheService, who: Engineer, measured: PartsName) -> Response:
    """Delete measured parts."""
    await operations.delete_parts(service, who, measured)
    return RedirectResponse("/measured", 303)
