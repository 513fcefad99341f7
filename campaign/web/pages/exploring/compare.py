"""The page that compares two campaigns: means, sigmas and Cpk side by side, and their differences."""

import json
from typing import Annotated, Any
from urllib.parse import urlencode

from fastapi import APIRouter, Form, Query, Request
from starlette.concurrency import run_in_threadpool
from starlette.responses import RedirectResponse, Response

from campaign.errors import CampaignError, StoreError
from campaign.web.answers.turns import Busy
from campaign.web.api.reports import report_files, write_comparison
from campaign.web.api.whose import PATTERN, TheCampaign, the_campaign
from campaign.web.http.asking import Engineer, TheService, Viewer
from campaign.web.pages.campaigns import frame
from campaign.web.pages.rendering import page

router = APIRouter(include_in_schema=False)
MOST_OFFERED = 500  # campaigns to choose from


@router.get("/campaigns/{campaign}/compare")
async def compare_page(
    request: Request,
    service: TheService,
    campaign: TheCampaign,
    who: Viewer,
    other: Annotated[str, Query(alias="with", pattern=PATTERN + "|^$")] = "",
) -> Response:
    """Show the comparison of a campaign with another one."""
    comparison, fault = None, ""
    if other:
        await the_campaign(service, who, other)
        try:
            document = json.loads((await service.answers.compare(who.name, campaign, other)).content)
            comparison = document["comparison"]
        except (Busy, StoreError):
            raise
        except CampaignError as error:
            fault = str(error)
    if service.watcher.listed_at is None:
        await service.watcher.list_campaigns()
    entries = [entry for entry, _ in service.watcher.index.entries() if entry.campaign != campaign]
    files = await run_in_threadpool(report_files, service, campaign, who)
    values: dict[str, Any] = {"other": other, "comparison": comparison, "fault": fault}
    values |= {"offered": entries[:MOST_OFFERED], "written": files.comparisons.get(other, [])}
    return page(request, "compare", **values, **await frame(request, service, campaign, who))


@router.post("/campaigns/{campaign}/compare")
async def compare_form(
    service: TheService,
    campaign: TheCampaign,
    who: Engineer,
    other: Annotated[str, Form(alias="with", pattern=PATTERN)],
) -> Response:
    """Write the report of a comparison."""
    await write_comparison(service, campaign, who, other)
    return RedirectResponse(f"/campaigns/{campaign}/compare?{urlencode({'with': other})}", 303)
