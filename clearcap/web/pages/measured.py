"""The pages of measured parts: a list with the form that sends some, the report of each, and lots against a plan."""

from datetime import UTC, datetime
from typing import Annotated, Any
from urllib.parse import quote, urlencode

from fastapi import APIRouter, Form, Request, UploadFile
from starlette.concurrency import run_in_threadpool
from starlette.responses import RedirectResponse, Response

from campaign.errors import CampaignError
from campaign.store.monitored_library import read_monitored
from clearcap.web.http.authentication import Engineer, OwnCampaign, TheCampaign, TheService, Viewer
from clearcap.web.http.responses import Refusal, refusal_of
from clearcap.web.jobs.queries import MOST_SETTINGS
from clearcap.web.operations import measured as operations
from clearcap.web.operations.measured import PartsCursor, PartsName
from clearcap.web.pages.campaigns import frame
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


@router.get("/campaigns/{campaign}/monitor")
async def monitor_page(request: Request, service: TheService, campaign: TheCampaign, who: Viewer) -> Response:
    """Show what the last measured lots say of a campaign."""
    return await _monitored(request, service, campaign, who)


@router.post("/campaigns/{campaign}/monitor")
async def monitor_form(
    request: Request,
    service: TheService,
    campaign: OwnCampaign,
    who: Engineer,
    file: UploadFile,
    limits: UploadFile | None = None,
    rerun: Annotated[bool, Form()] = False,
) -> Response:
    """Judge a campaign by measured lots, and show what they say."""
    given = limits if limits is not None and limits.filename else None  # a browser sends an empty field too
    try:
        await operations.monitor(service, campaign, who, file, given, rerun)
    except (CampaignError, Refusal) as error:
        refusal = refusal_of(error)
        assert refusal is not None
        return await _monitored(request, service, campaign, who, refusal)
    return RedirectResponse(f"/campaigns/{quote(campaign)}/monitor", 303)


async def _monitored(
    request: Request, service: Service, campaign: str, who: Viewer, refusal: Refusal | None = None
) -> Response:
    """Return the page of measured lots of a campaign, with the refusal of what was sent."""
    found = await run_in_threadpool(read_monitored, service.store, campaign)
    values: dict[str, Any] = {"found": found, "at": None, "falls": [], "what_if": ""}
    if found is not None:
        values["at"] = datetime.fromtimestamp(found.at, UTC)
        values["falls"] = [(each, datetime.fromtimestamp(each.at, UTC)) for each in reversed(found.falls)]
        if len(found.settings) <= MOST_SETTINGS:
            values["what_if"] = urlencode({"set": found.settings}, doseq=True)
    values |= await frame(request, service, campaign, who)
    return page(request, "monitor", refusal=refusal, address=service.settings.address, **values)
