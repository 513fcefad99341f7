"""The page of a campaign's sign-offs: who signed it, whether it has changed since, and the form to sign."""

from typing import Annotated, Any
from urllib.parse import quote

from fastapi import APIRouter, Form, Query, Request
from starlette.concurrency import run_in_threadpool
from starlette.responses import RedirectResponse, Response

from campaign.reports.signing.signoff_document import LONGEST_COMMENT
from campaign.web.access import Role
from campaign.web.api.signoffs import Signing, list_signoffs, show_content, signed
from campaign.web.api.whose import TheCampaign
from campaign.web.http.asking import Approver, Asking, TheService
from campaign.web.pages.campaigns import frame
from campaign.web.pages.rendering import page

router = APIRouter(include_in_schema=False)


@router.get("/campaigns/{campaign}/signoff")
async def signoff_page(
    request: Request,
    service: TheService,
    campaign: TheCampaign,
    who: Asking,
    check: Annotated[bool, Query()] = False,
) -> Response:
    """Show who signed a campaign, and to an approver the content that they would sign."""
    shown = await frame(request, service, campaign, who)
    signoffs = await run_in_threadpool(list_signoffs, service, campaign, who, check)
    may_sign = who.may(Role.APPROVER) and shown["entry"].state == "completed"
    content = await run_in_threadpool(show_content, service, campaign, who) if may_sign else None
    values: dict[str, Any] = {
        "signoffs": signoffs,
        "content": content,
        "checked": check,
        "longest_comment": LONGEST_COMMENT,
    }
    return page(request, "signoff", **values, **shown)


@router.post("/campaigns/{campaign}/signoff")
def sign_form(
    request: Request,
    service: TheService,
    campaign: TheCampaign,
    who: Approver,
    content: Annotated[str, Form(pattern="^[0-9a-f]{64}$")],
    comment: Annotated[str, Form(max_length=LONGEST_COMMENT)] = "",
) -> Response:
    """Sign a campaign."""
    signed(request, service, campaign, who, Signing(content=content, comment=comment))
    return RedirectResponse(f"/campaigns/{quote(campaign)}/signoff", 303)
