"""The page of a campaign's shared links, to create, copy and revoke them."""

from typing import Annotated
from urllib.parse import quote

from fastapi import APIRouter, Form, Path, Request
from starlette.concurrency import run_in_threadpool
from starlette.responses import RedirectResponse, Response

from campaign.web.access import Principal
from campaign.web.api.shares import ListedShare, MadeShare, NewShare, end_share, shared
from campaign.web.api.whose import TheCampaign
from campaign.web.http.asking import Engineer, TheService
from campaign.web.pages.campaigns import frame
from campaign.web.pages.rendering import page
from campaign.web.web_service import Service

router = APIRouter(include_in_schema=False)


@router.get("/campaigns/{campaign}/share")
async def share_page(request: Request, service: TheService, campaign: TheCampaign, who: Engineer) -> Response:
    """Show the shared links to a campaign."""
    return await _share_page(request, service, campaign, who)


@router.post("/campaigns/{campaign}/share")
async def share_form(
    request: Request,
    service: TheService,
    campaign: TheCampaign,
    who: Engineer,
    days: Annotated[int, Form(ge=1, le=90)] = 14,
    note: Annotated[str, Form(max_length=200)] = "",
) -> Response:
    """Create a link, and show it this once."""
    made = await run_in_threadpool(shared, request, service, campaign, who, NewShare(days=days, note=note))
    return await _share_page(request, service, campaign, who, made)


@router.post("/campaigns/{campaign}/share/{share}/revoke")
def revoke_share_form(
    service: TheService, campaign: TheCampaign, _: Engineer, share: Annotated[int, Path(ge=0, le=2**53)]
) -> Response:
    """Revoke a link."""
    end_share(service, campaign, share)
    return RedirectResponse(f"/campaigns/{quote(campaign)}/share", 303)


async def _share_page(
    request: Request, service: Service, campaign: str, who: Principal, made: MadeShare | None = None
) -> Response:
    """Return the page with the links, and one that was just created."""
    links = await run_in_threadpool(service.tokens.shares, campaign)
    shown = await frame(request, service, campaign, who)
    return page(request, "share", shares=[ListedShare.of(link) for link in links], made=made, **shown)
